"""What is reported of the steps in which advice acted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from orchestrator.results.records.record import _summary
from trainables import curve
from trainables.cell import Cell, Source
from trainables.knowledge import Knowledge
from trainables.learners.advice_statistics import NO_DELTA, advised_statistics, take_note
from trainables.learners.dqn import DeepLearner
from trainables.numerics.matmul import F32
from trainables.training.cell_run import run_cell
from trainables.training.messages import Outcome

SMALL: dict[str, Any] = {
    "episodes": 12,
    "evaluate_every": 4,
    "evaluation_episodes": 2,
    "hidden_size": 16,
    "batch_size": 8,
    "replay_capacity": 150,
    "target_update": 40,
    "learning_rate": 1e-3,
    "epsilon_start": 0.3,
}


@pytest.fixture(scope="module")
def source() -> Knowledge:
    learner = DeepLearner(Cell.create("dqn", "cartpole", 0, SMALL), None)
    learner.run(20)
    return learner.knowledge()


def cell(agent: str, steps: int = 10_000, **given: Any) -> Cell:
    named = Source(task="cartpole", kind="learned", cell_id="0" * 16, steps=steps)
    return Cell.create(agent, "cartpole:gravity=5x", 0, SMALL | given, None if agent == "dqn" else named)


class Watched(DeepLearner):
    """Notes max_a |delta(s,a)| of every state whose action is chosen with advice."""

    seen: list[float]

    def _action(self, observation: F32) -> int:
        self.seen.append(float(np.abs(self._advice.delta.row(observation)).max()))  # type: ignore[union-attr]
        before = float(self._advice.advised[0])
        action = super()._action(observation)
        if self._advice.advised[0] == before:
            self.seen.pop()
        return action


def test_an_advised_step_is_counted_with_its_factor_and_its_delta() -> None:
    advised = np.zeros(4)
    take_note(advised, np.array([0.5, -2.0], np.float32), np.array([1.0], np.float32))
    take_note(advised, np.array([0.0, 1.0], np.float32), NO_DELTA)
    assert advised_statistics(advised, with_delta=True) == pytest.approx(
        {
            "advised_factor": (np.exp(-1.0) + 1) / 2,
            "advised_delta": 1.5,
            "advised_paper_factor": (np.exp(-2.0) + np.exp(-1.0)) / 2,
        }
    )
    assert set(advised_statistics(advised, with_delta=False)) == {"advised_factor"}
    assert advised_statistics(np.zeros(4), with_delta=True) == {}


def test_delta_es_reports_the_mean_over_its_advised_steps_since_the_last_evaluation(source: Knowledge) -> None:
    learner = Watched(cell("delta_es"), source)
    for _ in range(2):
        learner.seen = []
        learner.run(4)
        statistics = learner.evaluate().statistics
        assert statistics["advised_delta"] == pytest.approx(np.mean(learner.seen))
        assert statistics["advised_factor"] == pytest.approx(np.exp(-np.array(learner.seen)).mean())
        assert "advised_paper_factor" not in statistics


def test_nothing_is_reported_of_advised_steps_once_the_advice_has_ended(source: Knowledge) -> None:
    learner = DeepLearner(cell("delta_es", steps=100), source)
    learner.run(4)
    assert "advised_factor" in learner.evaluate().statistics
    learner.run(4)
    assert learner._advice.kappa == 0.0
    learner.evaluate()
    learner.run(4)
    statistics = learner.evaluate().statistics
    assert not any(name.startswith(curve.ADVISED) for name in statistics)
    assert statistics["delta_sample_median"] > 0


@pytest.mark.parametrize(
    ("agent", "own", "paper"),
    [
        ("es", 1.0, None),
        ("corrected_es", 1.0, True),
        ("relative_es", None, True),
        ("shuffled_es", None, None),
        ("constant_es", None, None),
        ("delta_dpba", None, None),
    ],
)
def test_each_advice_reports_its_own_factor_and_the_papers_where_that_is_another(
    agent: str, own: float | None, paper: bool | None, source: Knowledge
) -> None:
    learner = DeepLearner(cell(agent, **({"floor_updates": 20} if agent == "relative_es" else {})), source)
    learner.run(4)
    statistics = learner.evaluate().statistics
    assert statistics["advised_factor"] == own if own else 0 < statistics["advised_factor"] <= 1
    assert ("advised_paper_factor" in statistics) == bool(paper)
    assert ("advised_delta" in statistics) == (agent not in ("es", "constant_es"))


@pytest.mark.parametrize(("agent", "reported"), [("dqn", False), ("warm_start", True), ("jsrl", True)])
def test_every_agent_with_a_source_reports_the_size_of_deltas_samples(
    agent: str, reported: bool, source: Knowledge
) -> None:
    learner = DeepLearner(cell(agent), source if reported else None)
    assert "delta_sample_median" not in learner.evaluate().statistics, "nothing is remembered yet"
    learner.run(2)
    assert ("delta_sample_median" in learner.evaluate().statistics) == reported


def test_the_cells_table_has_the_mean_over_the_points_with_advice(source: Knowledge) -> None:
    outcome = run_cell(cell("delta_es", steps=100), lambda _: source)
    assert isinstance(outcome, Outcome)
    given = [value for value in outcome.points["advised_factor"] if value is not None]
    assert 0 < len(given) < len(outcome.points["advised_factor"])

    class Ended:
        status, points, seconds = "done", outcome.points, outcome.seconds
        returns: list[Any] = outcome.points["greedy_return"]

    assert _summary(Ended)["mean_advised_factor"] == sum(given) / len(given)  # type: ignore[arg-type]
