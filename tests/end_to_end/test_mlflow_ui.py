"""MLflow's own pages on a small sweep, opened in a browser."""

from __future__ import annotations

import contextlib
import shutil
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mlflow.tracking import MlflowClient

from deltatune.publish import artifacts, publish
from orchestrator.analysis.findings import find
from orchestrator.model_registry import mlflow_registry
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.mlflow.views import LEADERBOARD, SECTION, VIEWS, View
from orchestrator.tracking.sync import sync_now
from orchestrator.tracking.ui import leaderboards
from orchestrator.tracking.uri import tracking_uri
from tests.small_figures import small_figures

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.browser,
    pytest.mark.skipif(CHROMIUM is None, reason="there is no chromium to open the pages with"),
]

OWN_NOISE = "/ajax-api/2.0/mlflow/users/current"
"""MLflow's UI asks who is logged in; a server without accounts answers 404, which the browser calls an error."""

PATIENCE = 120_000
"""Milliseconds for a page to come up on a busy machine."""


@pytest.fixture(scope="module")
def sweep(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Results:
    """A sweep in MLflow with its sources registered."""
    storage = tmp_path_factory.mktemp("shown") / "storage"
    shutil.copytree(finished, storage)
    results = Results.open(storage, "small")
    with small_figures():
        publish(results)
    uri = tracking_uri(storage, None)
    mlflow_registry.register_now(results, uri, sync_now(find(results), uri, artifacts(results)))
    return results


@pytest.fixture(scope="module")
def server(sweep: Results) -> Iterator[str]:
    """`deltatune ui` on the sweep; its address."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "deltatune.cli.main", "ui", "--storage", str(sweep.storage), "--port", str(port)]
    address = f"http://127.0.0.1:{port}"
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            _wait(address, process)
            yield address
        finally:
            process.terminate()
            process.wait()
    deadline = time.monotonic() + 10
    while answers(address) and time.monotonic() < deadline:
        time.sleep(0.05)
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(f"{address}/health", timeout=5)


def answers(address: str) -> bool:
    with contextlib.suppress(OSError):
        urllib.request.urlopen(f"{address}/health", timeout=5).close()
        return True
    return False


def _wait(address: str, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + PATIENCE / 1000
    while not answers(address):
        assert process.poll() is None
        if time.monotonic() > deadline:
            raise TimeoutError(address)
        time.sleep(0.2)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        context = chromium.new_context(viewport={"width": 1600, "height": 900})
        yield context  # whose pages share what they have loaded
        chromium.close()


class Page:
    """A page of the UI that remembers what the browser complained of."""

    def __init__(self, browser: Any, server: str) -> None:
        self.page = browser.new_page()
        self.page.set_default_timeout(PATIENCE)
        self._server = server
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._note)

    def _note(self, message: Any) -> None:
        if message.type == "error" and OWN_NOISE not in message.location.get("url", ""):
            self.errors.append(f"{message.text} {message.location}")

    def open(self, path: str, text: str) -> str:
        """All text of the page once `text` is on it."""
        self.page.goto(f"{self._server}/#/{path}")
        self.page.get_by_text(text).first.wait_for()
        shown: str = self.page.inner_text("body")
        return shown

    def column(self, key: str, legible: bool) -> list[str]:
        """The texts of a column of the runs table. legible: nothing may lie over its right end, or cut it off."""
        cells = self.page.locator(f"[role=row] [role=gridcell][col-id='{key}']")
        cells.nth(3).wait_for()
        box = cells.first.bounding_box()
        assert box is not None
        at = [box["x"] + box["width"] - 2, box["y"] + box["height"] / 2]
        there = "([x, y]) => document.elementFromPoint(x, y)?.closest('[col-id]')?.getAttribute('col-id')"
        assert not legible or self.page.evaluate(there, at) == key
        texts: list[str] = cells.all_inner_texts()
        return texts


@pytest.fixture
def page(browser: Any, server: str) -> Iterator[Page]:
    page = Page(browser, server)
    yield page
    page.page.close()
    assert page.errors == []


@pytest.fixture(scope="module")
def experiment(sweep: Results) -> str:
    found = MlflowClient(tracking_uri(sweep.storage, None)).get_experiment_by_name("deltatune/tests")
    assert found is not None
    return str(found.experiment_id)


def test_the_charts_of_the_leaderboard_begin_with_the_curves_and_their_intervals(page: Page, experiment: str) -> None:
    view = f"workflowType=machine_learning&viewStateShareKey={LEADERBOARD.key}&compareRunsMode=CHART"
    assert SECTION in page.open(f"experiments/{experiment}/runs?{view}", SECTION)


@pytest.mark.parametrize("view", VIEWS, ids=lambda view: view.key)
def test_each_view_opens_with_its_filter_and_columns(page: Page, sweep: Results, experiment: str, view: View) -> None:
    runs = MlflowClient(tracking_uri(sweep.storage, None)).search_runs([experiment], view.condition)
    link = f"experiments/{experiment}/runs?workflowType=machine_learning&viewStateShareKey={view.key}"
    text = page.open(link, f"{len(runs)} matching runs" if runs else view.name)
    field = page.page.get_by_placeholder("metrics.rmse").first
    playwright.expect(field).to_have_value(view.condition, timeout=PATIENCE)
    assert view.name in text
    for name in view.tags[:3] if runs else ():
        page.page.locator(f"[role=columnheader][col-id='tags.`{name}`']").wait_for()
    assert bool(runs) == (view.key != "deltatune-negative-transfer")


@pytest.mark.parametrize("width", [1400, 1000])
def test_one_click_from_ui_shows_auc_ratio_and_verdict_task_by_task(
    page: Page, sweep: Results, experiment: str, width: int
) -> None:
    paths = leaderboards(tracking_uri(sweep.storage, None))
    assert list(paths) == ["Leaderboard of tests"]
    page.page.set_viewport_size({"width": width, "height": 900})
    page.open(paths["Leaderboard of tests"].removeprefix("#/"), "matching runs")
    page.page.get_by_text("MLflow Assistant").first.wait_for()  # as the first visit of a browser opens it
    legible = ("AUC", "transfer_ratio", "verdict") if width == 1400 else ("AUC", "transfer_ratio")
    shown = {name: page.column(f"tags.`{name}`", name in legible) for name in ("AUC", "transfer_ratio", "verdict")}
    assert {"helped", "hurt", "undecided", "baseline"} >= set(shown["verdict"])
    client = MlflowClient(tracking_uri(sweep.storage, None))
    runs = client.search_runs([experiment], LEADERBOARD.condition, order_by=["tags.`place` ASC"])
    assert shown["AUC"] == [run.data.tags["AUC"] for run in runs][: len(shown["AUC"])]


def test_the_aucs_of_cells_are_legible_beside_the_assistant(page: Page, experiment: str) -> None:
    page.page.set_viewport_size({"width": 1000, "height": 900})
    link = f"experiments/{experiment}/runs?workflowType=machine_learning&viewStateShareKey=deltatune-cells"
    page.open(link, "matching runs")
    page.page.get_by_text("MLflow Assistant").first.wait_for()
    values = [float(text.removesuffix("…")) for text in page.column("metrics.`auc`", legible=True)]
    assert values == sorted(values, reverse=True)


def test_a_sweeps_page_says_what_was_asked_and_holds_the_figures(page: Page, sweep: Results, experiment: str) -> None:
    client = MlflowClient(tracking_uri(sweep.storage, None))
    run = client.search_runs([experiment], "tags.kind = 'sweep'")[0].info.run_id
    text = page.open(f"experiments/{experiment}/runs/{run}", "Description")
    assert sweep.name in text
    text = page.open(f"experiments/{experiment}/runs/{run}/artifacts", "best.yaml")
    assert {"table.csv", "cells.parquet", "points.parquet", "figures"} <= set(text.split())
    page.page.get_by_text("table.csv").click()
    page.page.get_by_text("policy_reuse").first.wait_for()
    page.page.get_by_text("report.html").click()
    report = page.page.frame_locator("iframe")
    report.locator("#chart-curves").scroll_into_view_if_needed()
    report.locator("#chart-curves svg.main-svg").first.wait_for()


def test_the_registry_shows_the_source_and_its_alias(page: Page) -> None:
    text = page.open("models/deltatune-windy_gridworld", "Version 2")
    assert "Source knowledge of the task windy_gridworld" in text
    assert "best" in text
    text = page.open("models/deltatune-windy_gridworld/versions/1", "Source Run")
    assert "q_learning / windy_gridworld / seed" in text
