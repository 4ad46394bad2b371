"""A sweep whose agent chooses from a library: stage 1 trains all of its tasks, and each is trained once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from conftest import LOCAL
from rich.console import Console

from orchestrator.execution.replay import replay
from orchestrator.execution.sweep import run
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import parse
from trainables.errors import InputError

SMALL, REVERSED = "windy_gridworld:wind=small", "windy_gridworld:wind=reversed"
SPACE: dict[str, Any] = {
    "schema": 1,
    "name": "library",
    "seeds": 2,
    "scenarios": [
        {
            "source": {"task": "windy_gridworld", "kinds": ["learned", "exact"], "library": [SMALL, REVERSED]},
            "targets": [SMALL, "windy_gridworld:wind=additional_1"],
        }
    ],
    "hyperparameters": {"episodes": [40]},
    "agents": {"q_learning": {}, "delta_gate": {"threshold": ["auto"]}, "delta_select": {}},
}


def test_every_task_of_the_library_is_trained_once_for_the_agent_that_chooses(tmp_path: Path) -> None:
    results = Results.create(tmp_path, "library", parse("library", SPACE))
    tally = run(results, LOCAL, Console(quiet=True))
    # Q-learning on SMALL is a cell of both stages, and trained in the first.
    assert (tally.ran, tally.failed) == (3 * 2 + 2 * (2 * 4 + 1), 0)
    plan = results.plan()
    assert sorted(cell.task for cell in plan["source"]) == sorted(2 * ["windy_gridworld", SMALL, REVERSED])
    chosen = [cell for cell in plan["transfer"] if cell.agent == "delta_select"]
    assert {cell.task: [source.task for source in cell.sources] for cell in chosen} == {
        SMALL: ["windy_gridworld", REVERSED],  # without the target itself
        "windy_gridworld:wind=additional_1": ["windy_gridworld", SMALL, REVERSED],
    }
    own = {(cell.task, cell.seed): cell.id for cell in plan["source"]}
    assert all(
        source.cell_id == own[source.task, cell.seed]
        for cell in chosen
        for source in cell.sources
        if source.kind == "learned"
    )
    assert all(len(cell.sources) == 1 for cell in plan["transfer"] if cell.agent == "delta_gate")
    assert replay(tmp_path, chosen[0].id).agrees
    again = run(results, LOCAL, Console(quiet=True))
    assert again.ran == 0
    other = Results.create(tmp_path, "other", parse("library", SPACE))
    third = run(other, LOCAL, Console(quiet=True))
    assert (third.ran, third.failed) == (tally.ran - 3 * 2, 0)  # no source is trained again
    assert other.record(own[SMALL, 1]) == results.record(own[SMALL, 1])


@pytest.mark.parametrize(
    ("source", "agents", "why"),
    [
        ({"library": [SMALL]}, {"delta_gate": {}}, "add delta_select"),
        ({"library": [SMALL, SMALL]}, {"delta_select": {}}, "given twice"),
        ({"library": ["windy_gridworld"]}, {"delta_select": {}}, "given twice"),
        ({"library": ["supply_chain"]}, {"delta_select": {}}, "2601 states"),
        ({"library": ["windy"]}, {"delta_select": {}}, "unknown task 'windy'"),
    ],
)
def test_a_library_that_cannot_be_used_is_refused_before_any_work(source, agents, why: str) -> None:
    scenario = {**SPACE["scenarios"][0], "source": {"task": "windy_gridworld", **source}}
    with pytest.raises(InputError, match=why):
        parse("library", SPACE | {"scenarios": [scenario], "agents": agents})
