"""How long MLflow's pages take with a large sweep: `python -m benchmarks.tracking.pages [--cells N] [--json]`.

A sweep of cells that do nothing is copied to a database, which `mlflow server` shows. Chromium opens the leaderboard
and the table of cells: from the request to the first row on the screen, the first time in a browser and the second,
when it has the page's scripts. Needs playwright, and Chromium as `chromium`.
"""

from __future__ import annotations

import argparse
import json
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.scaling import space
from benchmarks.tracking.server import TrackingServer
from orchestrator.tracking.mlflow.views import LEADERBOARD, VIEWS
from orchestrator.tracking.ui import leaderboards

PATIENCE = 120_000
"""Milliseconds for a page."""

PAGES = (LEADERBOARD.key, "deltatune-cells")

ROW = "[role=row] [role=gridcell]"


def measure(cells: int) -> dict[str, float]:
    """Return the number of cells, and seconds until each page shows its first row, at each visit."""
    with tempfile.TemporaryDirectory(prefix="deltatune-pages-") as name:
        folder = Path(name)
        leaderboard = _copied(folder, cells)
        server = TrackingServer(folder)
        server.start()
        try:
            paths = {view.name: leaderboard.replace(LEADERBOARD.key, view.key) for view in VIEWS if view.key in PAGES}
            return {"cells": cells, **_visited(server.uri, paths)}
        finally:
            server.kill()


def _copied(folder: Path, cells: int) -> str:
    """Run a sweep, copy it to the server's database, and return the path of its leaderboard."""
    from rich.console import Console

    from deltatune.publish import publish
    from orchestrator.execution.settings import Settings
    from orchestrator.execution.sweep import run
    from orchestrator.results.sweep_folder import Results
    from orchestrator.tracking.sync import sync
    from search_spaces.loading import parse

    results = Results.create(folder, "pages", parse("pages", space(cells, 1)))
    assert run(results, Settings(local=True, workers=1), Console(quiet=True)).failed == 0
    uri = f"sqlite:///{folder}/server.db"
    sync(publish(results).findings, uri, [])
    (leaderboard,) = leaderboards(uri).values()
    return leaderboard


def _visited(address: str, paths: dict[str, str]) -> dict[str, float]:
    """Return seconds by page and visit."""
    from playwright.sync_api import sync_playwright

    seconds: dict[str, float] = {}
    with sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        for name, path in paths.items():
            context = chromium.new_context(viewport={"width": 1600, "height": 900})
            for visit in ("first", "second"):
                page = context.new_page()
                page.set_default_timeout(PATIENCE)
                started = time.perf_counter()
                page.goto(f"{address}/{path}")
                page.locator(ROW).first.wait_for()
                seconds[f"{name}, {visit} visit"] = round(time.perf_counter() - started, 2)
                page.close()
            context.close()
        chromium.close()
    return seconds


def main() -> None:
    """Measure, and print a line a page or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=10_000)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    found: dict[str, Any] = measure(asked.cells)
    print(json.dumps(found) if asked.json else "\n".join(f"{value:10.2f}  {name}" for name, value in found.items()))


if __name__ == "__main__":
    main()
