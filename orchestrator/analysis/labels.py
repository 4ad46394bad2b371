"""The names of runs and configurations."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from orchestrator.analysis.groups import Group
from orchestrator.planning.confirmation import CONFIRMATION
from trainables.agents.registry import agent_named
from trainables.cell import Cell
from trainables.plugins.names import short
from trainables.tasks.registry import parse_task


def settings(group: Group) -> dict[str, Any]:
    """Return a configuration's hyperparameters to show: those that were tuned, and what `varied` returns."""
    return varied(group.agent, group.task, group.hyperparameters, group.tuned)


def varied(agent: str, task: str, values: Mapping[str, Any], also: Collection[str] = ()) -> dict[str, Any]:
    """Return the hyperparameters that are no defaults of the agent for the task, that define it, or are in `also`."""
    named = agent_named(agent)
    default = named.resolve(parse_task(task), {}).model_dump()
    always = {*named.shown, *also}
    return {name: value for name, value in values.items() if value != default.get(name) or name in always}


def settings_text(values: Mapping[str, Any]) -> str:
    """Return hyperparameters as 'name=value, ...'; a dash for none."""
    return (
        ", ".join(
            f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}" for name, value in values.items()
        )
        or "-"
    )


def cell_name(cell: Cell) -> str:
    """Return a cell's readable name; MLflow refuses brackets and equal signs in names."""
    parts = [
        run_name(cell.agent),
        run_name(cell.task),
        cell.sources[0].kind if cell.sources else "",
        f"seed {cell.seed}",
    ]
    return " / ".join(part for part in parts if part)


def group_name(group: Group) -> str:
    """Return a configuration's readable name."""
    name = configuration_name(group.task, group.agent, group.source_label, group.hyperparameters, group.tuned)
    return f"{name} / unseen seeds" if group.stage in CONFIRMATION else name


def configuration_name(
    task: str, agent: str, source: str, hyperparameters: Mapping[str, Any], tuned: Collection[str] = ()
) -> str:
    """Return the same from its parts, the agent first, since columns are narrow and the task has its own."""
    part = task.partition(":")[2] if ".py" not in task else ""
    text = settings_text(varied(agent, task, hyperparameters, tuned)).replace("=", " ")
    parts = [run_name(agent), run_name(part or task), run_name(source) if source != "none" else "", text]
    return " / ".join(part for part in parts if part and part != "-")


def run_name(task: str) -> str:
    """Return the name of a task or agent without the characters that MLflow refuses."""
    return short(task).replace("=", " ").replace("[", "(").replace("]", ")").replace(":", " ")


def shared(groups: Sequence[Group]) -> dict[str, Any]:
    """Return the hyperparameters to show that all groups share, without those that any of them has tuned."""
    every = [settings(group) for group in groups]
    if len(every) < 2:
        return {}
    tuned = frozenset[str]().union(*(group.tuned for group in groups))
    common = (name for name, value in every[0].items() if all(other.get(name) == value for other in every))
    return {name: every[0][name] for name in common if name not in tuned}
