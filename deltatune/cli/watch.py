"""Following a running sweep from another process, by the progress file in its folder."""

from __future__ import annotations

import json
import time
from dataclasses import asdict

from rich.console import Console

from orchestrator.execution.display import LOG_EVERY, bars, fields
from orchestrator.results import progress
from orchestrator.results.lock import driver
from orchestrator.results.status import KEYS, sweep_status
from orchestrator.results.sweep_folder import Results


def follow(results: Results, console: Console, every: float, as_json: bool = False) -> None:
    """Show a sweep's progress until no driver runs it any more, then a summary."""
    if as_json:
        _follow_json(results, every)
        return
    live, bar, printed = bars(console), None, 0.0
    if console.is_terminal:
        live.start()
    try:
        while (who := driver(results.folder)) is not None:
            snapshot = progress.read(results.folder)
            if snapshot is not None and console.is_terminal:
                bar = live.add_task(**fields(snapshot)) if bar is None else bar
                live.update(bar, **fields(snapshot))
            elif snapshot is not None and time.monotonic() - printed >= LOG_EVERY:
                printed = time.monotonic()
                console.print(f"{snapshot.line()} ({who})", soft_wrap=True)
            time.sleep(every)
    finally:
        live.stop()
    console.print(_ended(results), soft_wrap=True)


def _follow_json(results: Results, every: float) -> None:
    """Print each snapshot as a line of JSON, and at the end the data of `status`."""
    while driver(results.folder) is not None:
        if (snapshot := progress.read(results.folder)) is not None:
            print(json.dumps(asdict(snapshot)), flush=True)
        time.sleep(every)
    print(json.dumps(sweep_status(results)), flush=True)


def _ended(results: Results) -> str:
    stages = sweep_status(results)["stages"].values()
    done, failed, stopped, missing = (sum(stage[key] for stage in stages) for key in KEYS)
    counts = f"{done} cells done, {failed} failed" + (f", {stopped} stopped early" if stopped else "")
    if not stages:
        return f"{results.name} has not begun, and no driver is running it"
    return f"{results.name}: {counts}" + (f", {missing} missing, and no driver is running it" if missing else "")
