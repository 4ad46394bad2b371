"""Results in words: the names of runs, and the table that a person reads."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import yaml

from orchestrator.aggregates import Group
from orchestrator.given import options
from orchestrator.results import Results
from orchestrator.statistics import LEVEL, Estimate, TransferRatio
from trainables.agents import agent_named
from trainables.cell import Cell
from trainables.plugins.names import short
from trainables.tasks import parse_task

COLUMNS = (
    "task",
    "agent",
    "source",
    "hyperparameters",
    "seeds",
    "AUC mean (sd)",
    f"transfer ratio [{LEVEL:.0%}]",
    f"difference [{LEVEL:.0%}]",
)


NOTHING = 1e-9
"""A difference up to this is shown as 0."""


def varied(agent: str, task: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """The hyperparameters that are not at the agent's default for the task, and those that define the agent."""
    named = agent_named(agent)
    default = named.resolve(parse_task(task), {}).model_dump()
    own = set(named.hyperparameters.model_fields) & {"threshold", "nu", "advice_fraction"}
    return {name: value for name, value in values.items() if value != default.get(name) or name in own}


def settings_text(values: Mapping[str, Any]) -> str:
    """Hyperparameters as 'name=value, ...'; a dash for none."""
    return (
        ", ".join(
            f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}" for name, value in values.items()
        )
        or "-"
    )


def cell_name(cell: Cell) -> str:
    """A cell's name for people; MLflow refuses brackets and equal signs in names."""
    parts = [_short(cell.agent), _short(cell.task), cell.sources[0].kind if cell.sources else "", f"seed {cell.seed}"]
    return " / ".join(part for part in parts if part)


def group_name(group: Group) -> str:
    """A group's name for people."""
    text = settings_text(varied(group.agent, group.task, group.hyperparameters)).replace("=", " ")
    parts = [_short(group.agent), _short(group.task), group.source if group.source != "none" else "", text]
    return " / ".join(part for part in parts if part and part != "-")


def _short(task: str) -> str:
    return short(task).replace("=", " ").replace("[", "(").replace("]", ")").replace(":", " ")


def shared(groups: Sequence[Group]) -> dict[str, Any]:
    """The hyperparameters beside the defaults that all of several groups have in common."""
    every = [varied(group.agent, group.task, group.hyperparameters) for group in groups]
    if len(every) < 2:
        return {}
    return {name: value for name, value in every[0].items() if all(other.get(name) == value for other in every)}


def row(group: Group, hide: Collection[str] = ()) -> tuple[str, ...]:
    """A group's line of the table, under COLUMNS, without the hyperparameters in `hide`."""
    against, own = group.against_base, varied(group.agent, group.task, group.hyperparameters)
    seeds = f"{len(group.seeds)}" + (f", {group.failed} failed" if group.failed else "")
    seeds += f", {group.stopped} stopped early" if group.stopped else ""
    seeds += f", {group.missing} missing" if group.missing else ""
    mean = "-" if group.auc is None else f"{group.auc.value:.2f} ({group.auc_sd:.2f})"
    return (
        short(group.task),
        short(group.agent),
        group.source,
        settings_text({name: value for name, value in own.items() if name not in hide}),
        seeds,
        mean,
        ratio_text(against.transfer_ratio) if against else "-",
        estimate_text(against.difference) if against else "-",
    )


def estimate_text(estimate: Estimate) -> str:
    """'+3.2 [1.0, 5.4]'."""
    ends = ""
    if estimate.low is not None and estimate.high is not None:
        ends = f" [{signed(estimate.low, 1)}, {signed(estimate.high, 1)}]"
    return signed(estimate.value, 1) + ends


def ratio_text(ratio: TransferRatio) -> str:
    """'+12% [3, 21]', or 'undefined'."""
    if ratio.value is None:
        return "undefined"
    ends = ""
    if ratio.low is not None and ratio.high is not None:
        ends = f" [{signed(ratio.low * 100)}, {signed(ratio.high * 100)}]"
    return f"{signed(ratio.value * 100)}%{ends}"


def signed(value: float, digits: int = 0) -> str:
    """Return a number with its sign; one that rounds to 0 gets one digit more, so that -0.4 does not read as 0."""
    if round(value, digits) == 0 and abs(value) > NOTHING:
        digits += 1
    return f"{value if abs(value) > NOTHING else 0.0:+.{digits}f}"


def markdown(results: Results, groups: Sequence[Group]) -> str:
    """The description of a sweep's parent run: what was asked, the table, how to get it again."""
    space = results.space()
    lines = [f"# {results.name}", "", space.description or space.name, ""]
    lines += [f"|{'|'.join(COLUMNS)}|", "|" + "---|" * len(COLUMNS)]
    lines += _rows(groups)
    lines += ["", "Transfer ratio and difference are against the same agent without transfer, paired by seed.", ""]
    lines += [
        f"Again: `deltatune sweep SPACE.yaml --name {results.name}{options(results)}`, with the search space below as "
        "SPACE.yaml.",
        "",
    ]
    lines += ["Leaderboard: *Views* above the runs table, or its filter `tags.kind = 'aggregate'` sorted by `auc`.", ""]
    text = yaml.safe_dump(space.to_json(), sort_keys=False, width=110).rstrip()
    lines += ["```yaml", text, "```"] if len(text) < TABLE_CHARACTERS / 2 else ["The search space is in `sweep.json`."]
    return "\n".join(lines)


TABLE_CHARACTERS = 4000
"""Length of the table in a description, of which MLflow keeps 8,000 characters."""


def _rows(groups: Sequence[Group]) -> list[str]:
    """The lines of a Markdown table, as far as there is room."""
    lines = ["|" + "|".join(cell.replace("|", "/") for cell in row(group)) + "|" for group in groups]
    lengths = itertools.accumulate(len(line) + 1 for line in lines)
    kept = [line for line, length in zip(lines, lengths, strict=True) if length <= TABLE_CHARACTERS]
    more = len(lines) - len(kept)
    return [*kept, "", f"{more} more rows are in `table.csv`."] if more else kept
