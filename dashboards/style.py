"""One look for everything: colour-blind safe (after Okabe and Ito), readable in print, on light and on dark."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Look:
    """How an agent is drawn, the same everywhere: colour, dash and marker each tell it from its kin."""

    light: str
    """Colour on white."""
    dark: str
    """Colour on black: the same hue, lighter."""
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
"""Name of a marker in the report to its name in print."""

LOOKS = {
    "q_learning": Look("#4d4d4d", "#c9ccd1", (5, 3), "square"),
    "policy_reuse": Look("#e69f00", "#f5b83d", (1.5, 2.5), "diamond"),
    "ppr": Look("#0072b2", "#4aa8e8", (7, 3, 1.5, 3), "triangle-up"),
    "delta_gate": Look("#d55e00", "#ff8b45", (), "circle"),
    "confidence_gate": Look("#009e73", "#35cfa4", (9, 3), "triangle-down"),
    "q_warm_start": Look("#cc79a7", "#e79cc6", (6, 2, 1.5, 2, 1.5, 2), "x"),
    "delta_select": Look("#56b4e9", "#a5dbff", (2, 2), "pentagon"),
    "dqn": Look("#4d4d4d", "#c9ccd1", (5, 3), "square"),
    "es": Look("#0072b2", "#4aa8e8", (7, 3, 1.5, 3), "triangle-up"),
    "delta_es": Look("#d55e00", "#ff8b45", (), "circle"),
    "dpba": Look("#56b4e9", "#a5dbff", (1.5, 2.5), "diamond"),
    "delta_dpba": Look("#cc79a7", "#e79cc6", (6, 2, 1.5, 2, 1.5, 2), "x"),
    "delta_select_es": Look("#009e73", "#35cfa4", (9, 3), "triangle-down"),
}
"""Each agent's look; a deep agent has that of its tabular kin, which it never meets."""

OTHER = Look("#7a6a00", "#cbb94a", (3, 2), "x")
"""An agent without a look of its own."""

HELPED, HURT = "#1b7a5a", "#b3401f"
"""Positive and negative transfer in print."""


def look(agent: str) -> Look:
    """The look of an agent."""
    return LOOKS.get(agent, OTHER)


def rank(agent: str) -> int:
    """Where an agent stands in every legend: the order of LOOKS."""
    return list(LOOKS).index(agent) if agent in LOOKS else len(LOOKS)
