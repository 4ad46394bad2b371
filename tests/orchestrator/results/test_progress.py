"""How far a stage is, in one line."""

from __future__ import annotations

from orchestrator.results.progress import Progress
from orchestrator.results.records.record import Record
from trainables import curve
from trainables.cell import Cell
from trainables.curve import EvalPoint


def ended(task: str, value: float, agent: str = "q_learning") -> Record:
    points = curve.columns([EvalPoint(0, 10, value, value, None, {})])
    cell = Cell.create(agent, task, 0)
    return Record(
        cell=cell,
        status="done",
        error=None,
        points=points,
        digest=curve.digest(points),
        seconds=0.1,
        finished=1.0,
        versions={},
        commit="unknown",
    )


def test_the_best_auc_is_of_one_task() -> None:
    progress = Progress("transfer", 4)
    assert progress.snapshot().best == ""
    for task, value in (("cartpole", 200.0), ("acrobot", -90.0), ("acrobot", -300.0)):
        progress.ended(ended(task, value, "dqn"))
    # 200 in CartPole says nothing of Acrobot
    assert progress.snapshot().best == "best AUC on acrobot: -90.0 (dqn)"
    progress.ended(ended("cartpole", 10.0, "dqn"))
    assert progress.snapshot().best == "best AUC on cartpole: 200.0 (dqn)"
