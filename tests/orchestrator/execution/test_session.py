"""A sweep's session: a refused driver changes nothing, and on every way out things are said, freed and whole."""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from conftest import SPACE
from rich.console import Console

from deltatune import publish
from orchestrator.errors import InterruptedSweepError, SweepError
from orchestrator.execution import session
from orchestrator.execution.session import SweepSession
from orchestrator.execution.settings import RunSummary
from orchestrator.results.lock import driver, locked
from orchestrator.results.records.record import Record
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.tracker import Tracker
from search_spaces.search_space import SearchSpace
from tests.orchestrator.local_sweeps import LOCAL, snapshot, space
from tests.small_figures import small_figures
from trainables.errors import InputError


class Store:
    """A tracker's stand-in that notes what status MLflow was given."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.told: list[str | None] = []
        monkeypatch.setattr(Tracker, "record", lambda tracker, stage, record: None)
        monkeypatch.setattr(Tracker, "stop", lambda tracker, status="KILLED": self.told.append(status))
        monkeypatch.setattr(Tracker, "finish", lambda tracker, findings, files: self.told.append("FINISHED"))


@pytest.fixture
def store(monkeypatch: pytest.MonkeyPatch) -> Store:
    return Store(monkeypatch)


def opened(storage: Path, body: Callable[[SweepSession], object], asked: SearchSpace | None = None, **how: Any) -> None:
    """A session with this body."""
    with SweepSession.open(storage, "small", asked or space(), **how) as now:
        body(now)


def raises(error: BaseException) -> Callable[[SweepSession], None]:
    def body(now: SweepSession) -> None:
        raise error

    return body


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    storage = tmp_path_factory.mktemp("done")
    with SweepSession.open(storage, "small", space()) as now:
        assert now.run(LOCAL).failed == 0
        with small_figures():
            publish.publish(now.results)
    return storage


def test_a_second_driver_is_refused_and_changes_nothing_on_disk(done: Path) -> None:
    with locked(done / "small"):
        before = snapshot(done)
        other = space(scenarios=[SPACE["scenarios"][0] | {"targets": ["windy_gridworld:wind=small"]}])  # type: ignore[index]
        with pytest.raises(InputError, match=f"is being run by process {os.getpid()} on "):
            opened(done, print, other)
        assert snapshot(done) == before
        assert driver(done / "small") is not None


def test_another_search_space_is_refused_and_changes_nothing(done: Path) -> None:
    before = snapshot(done)
    with pytest.raises(InputError, match="belongs to the search space"):
        opened(done, print, space(name="other"))
    assert snapshot(done) == before


@pytest.mark.usefixtures("quick_figures")
def test_a_sweep_that_is_done_is_finished_in_mlflow_and_free(done: Path, store: Store) -> None:
    with SweepSession.open(done, "small", space(), tracking_uri="sqlite:///x") as now:
        now.run(LOCAL)
        published = publish.publish(now.results)
        now.finish(published.findings, [])
        assert driver(done / "small") is not None
    assert store.told == ["FINISHED"]
    assert driver(done / "small") is None


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (SweepError("no configuration is complete"), "FAILED"),
        (ZeroDivisionError("a figure"), "FAILED"),
        (OSError(28, "No space left on device"), "FAILED"),
        (KeyboardInterrupt(), "KILLED"),
        (InterruptedSweepError("interrupted"), "KILLED"),
    ],
    ids=lambda value: type(value).__name__,
)
def test_whatever_ends_a_session_mlflow_is_told_and_the_lock_is_free(
    done: Path, store: Store, error: BaseException, status: str
) -> None:
    said = io.StringIO()
    console = Console(file=said, width=500)
    with pytest.raises(type(error)):
        opened(done, raises(error), tracking_uri="sqlite:///x", console=console)
    assert store.told == [status]
    assert (
        said.getvalue()
        .splitlines()[-1]
        .endswith(f"finished cells are kept in {done / 'small'}; the same command continues from there")
    )
    assert driver(done / "small") is None


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP], ids=["sigterm", "sighup"])
def test_a_signal_outside_of_a_stage_is_a_way_out_too(done: Path, store: Store, number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with pytest.raises(InterruptedSweepError, match="the same command continues"):
        opened(done, lambda now: os.kill(os.getpid(), number), tracking_uri="sqlite:///x")
    assert store.told == ["KILLED"]
    assert driver(done / "small") is None
    assert signal.getsignal(number) == before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=["ctrl-c", "sigterm", "sighup"])
def test_a_signal_in_a_stage_leaves_the_rest_for_the_same_command(
    tmp_path: Path, done: Path, store: Store, number: signal.Signals
) -> None:
    told: list[Record] = []

    def stop(tracker: Tracker, stage: str, record: Record) -> None:
        told.append(record)
        os.kill(os.getpid(), number)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Tracker, "record", stop)
        with SweepSession.open(tmp_path, "small", space(), tracking_uri="sqlite:///x") as now:
            tally = now.run(LOCAL)
    every = {cell.id for cells in Results(done / "small").plan().values() for cell in cells}
    assert tally.ran + tally.left == len(every), "the transfers that no source is there for yet are counted"
    assert store.told == ["KILLED"]
    with SweepSession.open(tmp_path, "small", space()) as now:
        assert now.run(LOCAL).reused == tally.ran == len(told)
    assert points(tmp_path).equals(points(done))


def points(storage: Path) -> Any:
    return Results.open(storage, "small").write_tables()[1].drop(columns=["seconds"])


def test_a_driver_whose_lease_is_taken_over_stops_with_a_sentence_and_leaves_mlflow_alone(
    done: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "run_held", lambda *words: RunSummary(left=3))

    def body(now: SweepSession) -> None:
        now._hold.lost = True
        now.run(LOCAL)

    with pytest.raises(SweepError, match=r"was taken over by .*what it has recorded is kept"):
        opened(done, body, tracking_uri="sqlite:///x")
    assert store.told == [None]
    assert (done / "small" / "sweep.json").exists()


@pytest.mark.usefixtures("quick_figures")
def test_one_figures_error_costs_that_figure_alone(done: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from dashboards.figures import transfer_matrix

    def broken(*words: object) -> None:
        raise ValueError("could not convert")

    monkeypatch.setattr(transfer_matrix, "chart", broken)
    (done / "small" / "best.yaml").unlink(missing_ok=True)
    published = publish.publish(Results.open(done, "small"))
    assert published.missing == ["matrix (ValueError: could not convert)"]
    assert published.best is not None
    assert published.best.exists()
    assert published.report is not None
    assert "could not be drawn" in published.report.read_text()
    assert any(path.stem == "curves" for path in published.figures)


def test_a_report_that_cannot_be_drawn_costs_no_table(done: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*words: object, **more: object) -> None:
        raise MemoryError

    for name in ("best.yaml", "table.csv", "configurations.csv", "cells.parquet"):
        (done / "small" / name).unlink(missing_ok=True)
    monkeypatch.setattr(publish, "begin", broken)
    published = publish.publish(Results.open(done, "small"))
    assert (published.report, published.missing) == (None, ["report (MemoryError: )"])
    for name in ("best.yaml", "table.csv", "configurations.csv", "cells.parquet"):
        assert (done / "small" / name).exists()


def test_what_the_end_needs_is_imported_while_cells_run(tmp_path: Path) -> None:
    heavy = ("mlflow", "pandas", "matplotlib", "torch", "ray")
    code = "import sys, orchestrator.execution.session, deltatune.cli.commands.sweep as s"
    before = f"{code}; print([name for name in {heavy} if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", before], capture_output=True, text=True, check=True).stdout == "[]\n"
    where, over = list[str](), threading.Event()

    def load() -> None:
        where.append(threading.current_thread().name)
        over.set()
        raise ImportError("whoever needs it says so")

    with SweepSession.open(tmp_path, "small", space()) as now:
        assert now.run(LOCAL, meanwhile=load).failed == 0
        assert over.wait(10.0)
        assert now.run(LOCAL, meanwhile=load).ran == 0, "nothing runs, so nothing is loaded beside it"
    assert where == ["meanwhile"]


@pytest.mark.usefixtures("quick_figures")
def test_the_numbers_of_every_configuration_are_published(done: Path) -> None:
    published = publish.publish(Results.open(done, "small"))
    table = pd.read_csv(done / "small" / "configurations.csv")
    assert table["auc"].tolist() == [group.auc.value for group in published.findings.groups if group.auc]
    assert done / "small" / "configurations.csv" in publish.artifacts(Results.open(done, "small"))
