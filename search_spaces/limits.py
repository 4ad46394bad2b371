"""How large a search space may be: beyond these numbers a mistake is likelier than a wish."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

MOST_CELLS = 1_000_000
"""Cells that a search space may make."""

MOST_CONFIGURATIONS = 10_000
"""Configurations of one task, agent and source: what a grid multiplies to, or a search's budget."""

MOST_SEEDS = 1_000
MOST_TARGETS = 1_000
"""Target tasks of a scenario."""

MOST_SCENARIOS = 100
MOST_LIBRARY = 100
"""Source tasks of a library."""

LARGEST_SEED = 2**63 - 1
"""What a column of whole numbers holds."""


def twice(names: Iterable[str]) -> list[str]:
    """Return the names that are there more than once, in order."""
    return sorted(name for name, count in Counter(names).items() if count > 1)
