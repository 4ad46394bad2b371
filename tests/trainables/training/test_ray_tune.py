"""Every agent/task pair is a trainable for anyone's own Tuner, and reports what a plain run gives."""

from __future__ import annotations

from pathlib import Path

import pytest
from ray import tune

from orchestrator.sources.library import SourceLibrary
from trainables.cell import Cell, Source
from trainables.errors import InputError
from trainables.training.ray_tune import metrics, register_all, trainable
from trainables.training.train import train

REVERSED = "windy_gridworld:wind=reversed"


def fit(run: object, config: dict[str, object], folder: Path) -> tune.ResultGrid:
    return tune.Tuner(
        run,
        param_space=config,
        tune_config=tune.TuneConfig(metric="auc", mode="max", reuse_actors=True),
        run_config=tune.RunConfig(storage_path=str(folder), verbose=0),
    ).fit()


def test_a_registered_pair_runs_by_its_name_in_a_plain_tuner(ray_session: None, tmp_path: Path) -> None:
    names = register_all()
    assert f"delta_gate/{REVERSED}" in names
    assert "dqn/cartpole:gravity=5x" in names
    grid = fit(f"delta_gate/{REVERSED}", {"seed": tune.grid_search([0, 1]), "episodes": 40, "threshold": 3.0}, tmp_path)
    assert not grid.errors
    for result in grid:
        source = Source(task="windy_gridworld", kind="exact")
        values = {"episodes": 40, "threshold": 3.0}
        cell = Cell.create("delta_gate", REVERSED, result.config["seed"], values, source)
        points = list(train(cell))
        last = metrics(points[-1])
        timed = {"seconds", "steps_per_second"}
        assert {name: result.metrics[name] for name in last if name not in timed} == {
            name: value for name, value in last.items() if name not in timed
        }
        assert result.metrics["cell_id"] == cell.id
        assert result.metrics["auc"] == sum(point.greedy_return for point in points) / len(points)
        assert result.metrics["training_iteration"] == len(points)


def test_bad_hyperparameters_fail_the_trial_with_a_sentence(ray_session: None, tmp_path: Path) -> None:
    grid = fit(trainable("q_learning", "windy_gridworld"), {"learning_rate": -1}, tmp_path)
    assert "learning_rate must be greater than 0 (got -1)" in str(grid.errors[0])


def test_a_learned_source_comes_from_a_file_of_the_library(tmp_path: Path) -> None:
    cell = Cell.create("q_learning", "windy_gridworld", 0, {"episodes": 20})
    training = train(cell)
    list(training)
    library = SourceLibrary(tmp_path)
    library.save(cell, training.knowledge())
    trainable("delta_gate", REVERSED)({"episodes": 10, "source_file": str(library.path(cell.id))})


def test_a_deep_pair_without_a_source_file_says_what_it_needs() -> None:
    with pytest.raises(InputError, match="es needs source_file"):
        trainable("es", "cartpole:gravity=5x")({"episodes": 1})


@pytest.mark.parametrize(("agent", "task"), [("dqm", "cartpole"), ("dqn", "cartpol")])
def test_an_unknown_name_is_refused_before_anything_runs(agent: str, task: str) -> None:
    with pytest.raises(InputError, match="unknown"):
        trainable(agent, task)
