"""The study of delta's factor: its table says what the statistics of the cells do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from conftest import LOCAL
from rich.console import Console
from scipy import stats

from benchmarks.studies import delta_factor
from orchestrator.dataset.dataset import Dataset
from orchestrator.execution.sweep import run
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import load
from search_spaces.narrow import narrow

TINY = {"episodes": 10, "evaluate_every": 1, "evaluation_episodes": 1, "hidden_size": 8, "batch_size": 8}
ADVISED = {"floor_updates": 5, "epsilon_start": 0.1, "advice_fraction": 1.0}
DOCS = Path(__file__).parents[2] / "docs"
TASKS = ("acrobot", "acrobot:link_mass=2")


def drawn() -> tuple[pd.DataFrame, pd.DataFrame]:
    """Cells and points of four seeds of two tasks, ten evaluations after the first."""
    rng, cells, points = np.random.default_rng(0), [], []
    for task in TASKS:
        for seed in range(4):
            cell = f"{task}{seed}"
            cells.append({"cell_id": cell, "task": task, "seed": seed, "agent": "relative_es"})
            for episode in range(0, 101, 10):
                numbers = {name: rng.uniform() if episode else np.nan for name in delta_factor.STATISTICS}
                points.append({"cell_id": cell, "episode": episode, **numbers})
    return pd.DataFrame(cells), pd.DataFrame(points)


def test_both_factors_are_told_and_how_far_they_fall_from_the_own_task() -> None:
    cells, points = drawn()
    rows = points.merge(cells, on="cell_id").set_index(["task", "seed", "episode"])["advised_paper_factor"]
    last = [[rows.loc[task, seed, 90:100].mean() for seed in range(4)] for task in TASKS]
    low, high = stats.ttest_rel(last[1], last[0]).confidence_interval(0.95)
    first = np.mean([rows.loc["acrobot:link_mass=2", seed, 10:20].mean() for seed in range(4)])
    own, other = delta_factor.report(delta_factor.factors(cells, points))[2:]
    assert own.startswith("|acrobot|4|")
    assert own.count("|-|") == 3
    _, _, _, _, _, there, gap, *_ = other.split("|")
    assert there.startswith(f"{first:.2f}, {np.mean(last[1]):.2f} [")
    assert gap == f"{np.mean(last[1]) - np.mean(last[0]):+.2f} [{low:+.2f}, {high:+.2f}]"


def test_the_page_has_the_table_of_the_published_cells() -> None:
    table = delta_factor.report(delta_factor.published(Dataset(DOCS / "dataset")))
    assert "\n".join(table) in (DOCS / "delta_factor.md").read_text()


def test_its_space_gives_both_factors(tmp_path: Path) -> None:
    space = load(str(Path(delta_factor.__file__).parent / "delta_factor_500.yaml"))
    small = narrow(space, tasks=["cartpole"], seeds=2, hyperparameters=TINY | ADVISED)
    results = Results.create(tmp_path, space.name, small)
    assert run(results, LOCAL, Console(quiet=True)).failed == 0
    found = delta_factor.factors(*results.write_tables())
    assert list(found["task"].unique()) == ["cartpole", "cartpole:gravity=49", "cartpole:gravity=68.6"]
    for name in delta_factor.STATISTICS:
        assert (found["first", name].dropna() >= 0).all()
        assert found["first", name].notna().any()
