"""What one cell of each usual agent would cost on a task."""

from __future__ import annotations

from dataclasses import dataclass

from orchestrator.present import span
from trainables.rates import measure, probe
from trainables.tasks.task import Task


@dataclass(frozen=True)
class AgentCost:
    """An agent's measured speed on a task, and what a cell with its default hyperparameters takes on one core."""

    agent: str
    steps_per_second: float
    """Environment step and update together."""
    episodes: int
    seconds_low: float
    """With episodes as long as an untrained agent's."""
    seconds_high: float
    """With every episode as long as the time limit allows."""

    def row(self) -> tuple[str, str, str]:
        """A line of a table."""
        cost = span(self.seconds_low, self.seconds_high)
        return self.agent, f"{self.steps_per_second:,.0f}", f"{self.episodes} episodes: {cost}"


def task_costs(task: Task) -> list[AgentCost]:
    """The costs of the agent without transfer and of the paper's with it; about two seconds each."""
    agents = ("q_learning", "delta_gate") if task.tabular else ("dqn", "delta_es")
    return [_cost(agent, task) for agent in agents]


def _cost(agent: str, task: Task) -> AgentCost:
    cell = probe(agent, task.name, task.name, {})
    rate, values = measure(cell), dict(cell.hyperparameters)
    spans = sorted(rate.seconds(values, steps) for steps in (None, float(rate.time_limit)))
    return AgentCost(agent, 1 / rate.seconds_per_step, int(values["episodes"]), *spans)
