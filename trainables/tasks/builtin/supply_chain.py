"""Supply chain with a factory and one warehouse (paper, Appendix B): the task's features. Light to import."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trainables.tasks.spec.family import Context, ContextFeature, TaskFamily, number

if TYPE_CHECKING:
    from trainables.tasks.spec.tabular_model import Dynamics, TransitionModel


def _dynamics(context: Context) -> Dynamics:
    from trainables.tasks.builtin.supply_chain_model import dynamics

    return dynamics(context)


def _model(context: Context) -> TransitionModel:
    from trainables.tasks.builtin.supply_chain_model import model

    return model(context)


FAMILY = TaskFamily(
    name="supply_chain",
    description="a factory that supplies one warehouse under Poisson demand; profit of 200 steps",
    features=(ContextFeature("demand_mean", 2.5, "mean demand per step (lambda)", number(1e-6, 50.0)),),
    defaults={"episodes": 1000, "threshold": 5.0, "delta_learning_rate": 0.1, "truncation": "terminal"},
    targets=("supply_chain:demand_mean=2", "supply_chain:demand_mean=5"),
    dynamics=_dynamics,
    model=_model,
)
