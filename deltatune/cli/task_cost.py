"""The measured cost of one cell of each usual agent on a task."""

from __future__ import annotations

from dataclasses import dataclass

from deltatune.cli.tables import span
from trainables.agents.registry import AGENTS
from trainables.tasks.spec.family import Task
from trainables.training.throughput import measure, probe


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
        """Return a row of the table that `check` prints."""
        cost = span(self.seconds_low, self.seconds_high)
        return self.agent, f"{self.steps_per_second:,.0f}", f"{self.episodes} episodes: {cost}"


def task_costs(task: Task) -> list[AgentCost]:
    """Return the costs of the agent without transfer and of the paper's algorithm; about two seconds each."""
    usual = [agent for agent in AGENTS.values() if agent.usual and (agent.kind == "tabular") == task.tabular]
    return [_cost(agent.name, task) for agent in usual if not agent.needs_source or agent.algorithm]


def _cost(agent: str, task: Task) -> AgentCost:
    cell = probe(agent, task.name, task.name, {})
    rate, values = measure(cell), dict(cell.hyperparameters)
    spans = sorted(rate.seconds(values, steps) for steps in (None, float(rate.time_limit)))
    return AgentCost(agent, 1 / rate.seconds_per_step, int(values["episodes"]), *spans)
