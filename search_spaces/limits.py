"""How large a search space may be; anything larger is more likely a mistake."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

MAX_CELLS = 1_000_000
"""Cells of a search space."""

MAX_CONFIGURATIONS = 10_000
"""Configurations of one arm: the product of a grid, or a search's budget."""

MAX_SEEDS = 1_000
MAX_TARGETS = 1_000
"""Target tasks of a scenario."""

MAX_SCENARIOS = 100
MAX_LIBRARY = 100
"""Source tasks of a library."""

MAX_SEED = 2**63 - 1
"""The largest 64-bit integer."""


def twice(names: Iterable[str]) -> list[str]:
    """Return the names that occur more than once, sorted."""
    return sorted(name for name, count in Counter(names).items() if count > 1)
