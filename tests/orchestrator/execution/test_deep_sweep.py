"""Sweeps of deep agents: whose knowledge advises whom, the bits of a plain process, and going on after a crash."""

from __future__ import annotations

import contextlib
import copy
import os
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import LOCAL, timeless
from rich.console import Console

from orchestrator.execution.replay import replay
from orchestrator.execution.settings import Settings
from orchestrator.execution.sweep import run
from orchestrator.planning.plan import source_arms, transfer_arms
from orchestrator.planning.source_choice import SourceChoice, SourceRun
from orchestrator.results.sweep_folder import Results
from orchestrator.sources.library import SourceLibrary
from search_spaces.loading import parse
from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.errors import InputError
from trainables.training import cell_run

SPACE: dict[str, Any] = {
    "schema": 1,
    "name": "deep",
    "seeds": 2,
    "scenarios": [
        {
            "source": {"task": "cartpole", "agent": "dqn", "hyperparameters": {"learning_rate": [0.001]}},
            "targets": ["cartpole:gravity=5x"],
        }
    ],
    "hyperparameters": {
        "episodes": [30],
        "evaluate_every": [10],
        "evaluation_episodes": [3],
        "hidden_size": [16],
        "batch_size": [16],
    },
    "agents": {"dqn": {}, "es": {}, "delta_es": {"advice_fraction": [0.5]}},
}
CELLS = 2 + 3 * 2


def small(**changes: Any) -> Cell:
    values = {name: option[0] for name, option in SPACE["hyperparameters"].items()} | changes
    return Cell.create("dqn", "cartpole", 0, values)


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Results:
    results = Results.create(tmp_path_factory.mktemp("deep"), "deep", parse("deep", SPACE))
    tally = run(results, LOCAL, Console(quiet=True))
    assert (tally.ran, tally.failed) == (CELLS, 0)
    return results


def test_a_sweep_gives_the_bits_of_a_plain_run(swept: Results) -> None:
    cells, _ = swept.write_tables()
    for cell_id in cells.drop_duplicates("agent")["cell_id"]:
        assert replay(swept.storage, cell_id).agrees


def test_each_advised_cell_reports_delta_and_advice(swept: Results) -> None:
    _, points = swept.write_tables()
    assert {"kappa", "advice_factor", "delta_mean", "delta_p90", "epsilon", "loss"} <= set(points.columns)


def test_all_seeds_are_advised_by_the_best_source_with_their_own_seeds_steps(swept: Results) -> None:
    sources = {cell.seed: cell.sources[0] for cell in swept.plan()["transfer"] if cell.agent == "es"}
    runs = {cell.seed: swept.record(cell.id) for cell in swept.plan()["source"]}
    assert len({source.cell_id for source in sources.values() if source}) == 1
    for seed, source in sources.items():
        record = runs[seed]
        assert source is not None
        assert record is not None
        assert (source.checkpoint, source.steps) == ("best", record.points["step"][-1])


@pytest.mark.parametrize(("pick", "models"), [("own_seed", (0, 1)), ("best_evaluated", (1, 1)), (0, (0, 0))])
def test_the_pick_decides_whose_knowledge_advises(pick: Any, models: tuple[int, int]) -> None:
    data = copy.deepcopy(SPACE)
    data["scenarios"][0]["source"]["pick"] = pick
    space = parse("deep", data)
    arm = source_arms(space, {})[0]["cartpole"]
    cells = arm.cells(arm.grid[0])
    runs = {cell.seed: SourceRun(cell, best_return=200.0, auc=100.0 + cell.seed, steps=10) for cell in cells}
    transfers = transfer_arms(space, [{"cartpole": SourceChoice(arm.grid[0], runs)}], {})
    sources = next(arm.sources for arm in transfers if arm.agent == "es")
    assert [sources[seed][0][0].cell_id for seed in (0, 1)] == [cells[model].id for model in models]
    assert sources[0][0][0].checkpoint == ("last" if pick == "own_seed" else "best")


def test_a_seed_that_is_not_there_cannot_be_picked() -> None:
    data = copy.deepcopy(SPACE)
    data["scenarios"][0]["source"]["pick"] = 7
    with pytest.raises(InputError, match=r"source\.pick must be one of the seeds \(got 7\)"):
        parse("deep", data)


def test_a_cell_that_is_cut_off_twice_goes_on_bit_for_bit(tmp_path: Path) -> None:
    whole = cell_run.run_cell(small(), lambda cell: None, keep=True)
    for expected in ([0, 10], [20, 30]):
        episodes: list[int] = []
        _cut_off(tmp_path, expected[-1], episodes)
        assert episodes == expected
    resumed = cell_run.run_cell(small(), lambda cell: None, keep=True, checkpoints=tmp_path, checkpoint_seconds=0)
    assert resumed.digest == whole.digest
    assert resumed.knowledge == whole.knowledge


def _cut_off(folder: Path, episode: int, seen: list[int]) -> None:
    """Run a cell until that episode's evaluation, where its process is gone."""

    def gone(point: EvalPoint) -> None:
        seen.append(point.episode)
        if point.episode == episode:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        cell_run.run_cell(small(), lambda cell: None, checkpoints=folder, checkpoint_seconds=0, on_point=gone)


def test_a_half_written_checkpoint_is_not_taken_for_a_whole_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = cell_run.run_cell(small(), lambda cell: None)
    _cut_off(tmp_path, 20, [])
    (path,) = tmp_path.glob("*.checkpoint")
    path.write_bytes(path.read_bytes()[:-100])
    assert cell_run.run_cell(small(), lambda cell: None, checkpoints=tmp_path).digest == whole.digest


def test_a_full_disk_costs_the_checkpoint_and_not_the_cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(cell_run.checkpoint, "save", full)
    assert cell_run.run_cell(small(), lambda cell: None, checkpoints=tmp_path, checkpoint_seconds=0).status == "done"


@pytest.mark.slow  # tests/faults/test_workers.py does the same with cells of tabular agents
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds the worker in /proc")
def test_a_killed_worker_is_replaced_and_the_table_is_the_same(
    swept: Results, tmp_path: Path, ray_session: None
) -> None:
    results = Results.create(tmp_path, "deep", parse("deep", SPACE))
    killed: list[int] = []
    thread = threading.Thread(target=_kill_a_worker, args=(results, killed))
    thread.start()
    tally = run(results, Settings(checkpoint_seconds=0), Console(quiet=True))
    thread.join()
    assert killed
    assert tally.failed == 0
    before, after = (timeless(each.write_tables()[1]) for each in (swept, results))
    assert after.equals(before)
    learned = [SourceLibrary(each.storage).load(each.plan()["source"][0].id).digest for each in (swept, results)]
    assert learned[0] == learned[1]


def _kill_a_worker(results: Results, killed: list[int]) -> None:
    """Kill a worker of this process's Ray that runs a trial, once the first cell has ended."""
    deadline = time.monotonic() + 120
    while not killed and time.monotonic() < deadline:
        time.sleep(0.02)
        if results.heads():
            killed += list(_own_workers())[:1]
            for pid in killed:
                os.kill(pid, signal.SIGKILL)


def _own_workers() -> Iterator[int]:
    """The processes below this one that run trials."""
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, IndexError):
            if b"ImplicitFunc" in (path / "cmdline").read_bytes() and _is_ours(int(path.name)):
                yield int(path.name)


def _is_ours(pid: int) -> bool:
    while pid > 1 and pid != os.getpid():
        pid = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    return pid == os.getpid()
