"""The study of collapsing base learners: its space runs, and its tables say what the curves do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import LOCAL
from rich.console import Console

from benchmarks.studies import collapse
from orchestrator.execution.sweep import run
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import load
from search_spaces.narrow import narrow

TINY = {"episodes": 4, "evaluate_every": 2, "evaluation_episodes": 1, "hidden_size": 8, "batch_size": 8}


def test_each_base_learner_has_a_row_and_its_differences_from_the_papers(tmp_path: Path) -> None:
    space = load(str(Path(collapse.__file__).with_suffix(".yaml")))
    results = Results.create(tmp_path, space.name, narrow(space, seeds=3, hyperparameters=TINY))
    assert run(results, LOCAL, Console(quiet=True)).failed == 0
    found = collapse.seeds(results)
    assert len(found) == 8
    assert {len(rows) for rows in found.values()} == {3}
    lines = collapse.report(found)
    assert sum(line.startswith("|10,000, plain, squared|3|") for line in lines) == 1
    assert sum(line.startswith("|100,000, double, huber|") for line in lines) == 1 + len(collapse.MEASURES)


@pytest.mark.parametrize(
    ("curve", "after"),
    [([10, 200, 50, 195], [50, 195]), ([10, 20], [10, 20]), ([10, 200], [10, 200])],
    ids=["solved", "never solved", "solved at the end"],
)
def test_what_counts_begins_after_the_first_solved_evaluation(curve: list[float], after: list[float]) -> None:
    assert collapse._after(np.array(curve)).tolist() == after
