"""source.pick ranked: on each target the network advises whose |delta| along its own path there is smallest."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
from conftest import DEEP, LOCAL, SPACE
from rich.console import Console

from orchestrator.analysis.findings import find
from orchestrator.execution.forecast import forecast
from orchestrator.execution.sources import source_ranking
from orchestrator.execution.sources.source_ranking import EPISODES, FILE, SEED
from orchestrator.execution.sweep import run
from orchestrator.results import checked_json
from orchestrator.results.sweep_folder import Results
from orchestrator.sources import ranking
from orchestrator.sources.library import SourceLibrary
from orchestrator.sources.ranking import own_path_delta
from search_spaces.loading import parse
from search_spaces.search_space import SearchSpace

SHORT = {"episodes": [30], "evaluate_every": [15], "evaluation_episodes": [1], "hidden_size": [8]}


def space(base: dict[str, Any], **source: Any) -> SearchSpace:
    data = copy.deepcopy(SPACE | base)
    data["scenarios"][0]["source"] |= {"pick": "ranked", "seeds": 3, **source}
    data["hyperparameters"] = {name: SHORT[name] for name in base.get("hyperparameters", {"episodes": []})}
    return parse("small", data)


TABULAR = space({}, kinds=["learned"])
NEURAL = space(DEEP)


@pytest.mark.parametrize("asked", [TABULAR, NEURAL], ids=["tabular", "deep"])
def test_the_network_with_the_smallest_delta_on_the_target_advises_there(tmp_path: Path, asked: SearchSpace) -> None:
    results = Results.create(tmp_path, "small", asked)
    assert run(results, LOCAL, Console(quiet=True)).failed == 0
    sizes = checked_json.read(results.folder / FILE)["delta"]
    library = SourceLibrary(tmp_path)
    advised = [cell for cell in results.plan()["transfer"] if cell.sources]
    assert {cell.task for cell in advised} == set(sizes)
    for cell in advised:
        here = sizes[cell.task]
        assert len(here) == 3
        assert here[str(cell.sources[0].cell_id)] == min(here.values())
    task, here = next(iter(sizes.items()))
    again = own_path_delta(task, [library.entry(name) for name in here], EPISODES, SEED)
    assert again == list(here.values())
    assert {group.pick for group in find(results).best if group.source == "learned"} == {"ranked"}


def test_what_was_ranked_once_stays_and_a_dry_run_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results = Results.create(tmp_path, "small", TABULAR)
    ahead = forecast(TABULAR, LOCAL, results, workers=1)
    assert not (results.folder / FILE).exists()
    run(results, LOCAL, Console(quiet=True))
    monkeypatch.setattr(ranking, "own_path_delta", None)
    assert run(results, LOCAL, Console(quiet=True)).ran == 0
    after = forecast(TABULAR, LOCAL, results, workers=1)
    assert [stage.cells for stage in after.stages] == [stage.cells for stage in ahead.stages]
    assert all(stage.cells == stage.done for stage in after.stages)


def test_a_damaged_ranking_is_made_again(tmp_path: Path) -> None:
    results = Results.create(tmp_path, "small", TABULAR)
    run(results, LOCAL, Console(quiet=True))
    path = results.folder / FILE
    whole = path.read_bytes()
    path.write_bytes(whole[:40])
    assert run(results, LOCAL, Console(quiet=True)).ran == 0
    assert path.read_bytes() == whole


def test_a_target_that_cannot_be_played_loses_its_transfers_with_the_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*arguments: object) -> list[float]:
        raise ValueError("no such state")

    monkeypatch.setattr(ranking, "own_path_delta", broken)
    results = Results.create(tmp_path, "small", TABULAR)
    run(results, LOCAL, Console(quiet=True))
    errors = {head.error for head in results.heads().values() if head.status == "failed"}
    assert len(errors) == 1
    assert "the source networks cannot be ranked on windy_gridworld:wind=small" in str(errors)
    assert not (results.folder / source_ranking.FILE).exists()
