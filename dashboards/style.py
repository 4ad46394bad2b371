"""The colours, dashes and markers of agents: colour-blind safe (after Okabe and Ito), on light and dark, in print."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from trainables.agents.registry import AGENTS, agent_named
from trainables.plugins import names


@dataclass(frozen=True)
class Look:
    """How an agent is drawn in every figure; colour, dash and marker each distinguish it from similar agents."""

    light: str
    """Colour on white."""
    dark: str
    """Colour on black: the same hue, but lighter."""
    dash: tuple[float, ...] = ()
    """Lengths of line and gap in points; empty: solid."""
    marker: str = "circle"
    """A key of MARKERS."""


MARKERS = {
    "circle": "o",
    "square": "s",
    "diamond": "D",
    "triangle-up": "^",
    "triangle-down": "v",
    "pentagon": "p",
    "x": "X",
}
"""Plotly's name of each marker to matplotlib's."""

PALETTE = {
    "grey": Look("#4d4d4d", "#c9ccd1", (5, 3), "square"),
    "orange": Look("#e69f00", "#f5b83d", (1.5, 2.5), "diamond"),
    "blue": Look("#0072b2", "#4aa8e8", (7, 3, 1.5, 3), "triangle-up"),
    "vermilion": Look("#d55e00", "#ff8b45", (), "circle"),
    "green": Look("#009e73", "#35cfa4", (9, 3), "triangle-down"),
    "pink": Look("#cc79a7", "#e79cc6", (6, 2, 1.5, 2, 1.5, 2), "x"),
    "sky": Look("#56b4e9", "#a5dbff", (2, 2), "pentagon"),
    "olive": Look("#7a6a00", "#cbb94a", (3, 2), "x"),
    "violet": Look("#6a3d9a", "#b08be0", (4, 2, 1.5, 2), "diamond"),
    "brown": Look("#8c510a", "#c98d4b", (8, 2), "square"),
    "teal": Look("#01665e", "#4fb3a9", (2.5, 1.5), "triangle-up"),
    "ochre": Look("#b5651d", "#e8a15c", (1, 2), "triangle-up"),
    "plum": Look("#7b3f61", "#c084a6", (3, 1.5, 1, 1.5), "triangle-down"),
    "moss": Look("#4b5d16", "#a3bf4f", (5, 1.5), "circle"),
    "slate": Look("#37526d", "#8fb0cf", (6, 1.5, 2, 1.5), "x"),
    "rust": Look("#a23b1e", "#e57f5f", (2, 1), "square"),
    "pine": Look("#1f5b3a", "#63b886", (4, 1, 1, 1), "diamond"),
    "indigo": Look("#3f3d9e", "#8f8dea", (8, 1.5, 1, 1.5), "pentagon"),
    "steel": Look("#5b7083", "#a9bccd", (3, 3), "triangle-down"),
    "emerald": Look("#0b7a4b", "#4fd39a", (7, 1.5, 3, 1.5), "circle"),
    "wine": Look("#882255", "#d36a9d", (5, 2, 1.5, 2), "pentagon"),
}
"""Looks by name. A deep agent may share that of its tabular variant, since no figure shows both."""

HELPED, HURT = "#1b7a5a", "#b3401f"
"""Positive and negative transfer in print."""

_NAMED = {agent.name: agent.look for agent in AGENTS.values() if agent.look}
_FREE = [name for name in PALETTE if name not in _NAMED.values()]
"""The looks for agents that name none: one each, as long as there are enough."""

_ASSIGNED: dict[str, int] = {}
"""The agents without a look in the sweep that is drawn, in the order of its legends."""

_FIXED: dict[str, str] = {}
"""The looks that another process has given to agents, whose code may be unknown here."""


def fix(looks: Mapping[str, str]) -> None:
    """Draw these agents by looks of these names."""
    _FIXED.update(looks)


def assign(agents: Iterable[str]) -> None:
    """Prepare to draw a sweep of these agents: those without a look get one each, in this order."""
    _ASSIGNED.clear()
    for agent in agents:
        key(agent)


def key(agent: str) -> str:
    """Return the name of an agent's look, the same in every figure of a sweep."""
    if agent in _FIXED:
        return _FIXED[agent]
    named = _NAMED.get(agent) or (agent_named(agent).look if names.is_custom(agent) else "")
    return named if named in PALETTE else _FREE[_ASSIGNED.setdefault(agent, len(_ASSIGNED)) % len(_FREE)]


def look(agent: str) -> Look:
    """Return the look of an agent."""
    return PALETTE[key(agent)]


def rank(agent: str) -> int:
    """Return an agent's place in legends: the registry's order, then that of `assign`."""
    order = list(AGENTS)
    return order.index(agent) if agent in order else len(order) + _ASSIGNED.get(agent, len(_ASSIGNED))
