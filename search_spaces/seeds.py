"""Seeds in a search space: a list of them, or how many."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, Field

from search_spaces.limits import MAX_SEED, MAX_SEEDS
from trainables.errors import shown


def _seeds(value: object) -> object:
    """Return the seeds 0..n-1 for a number n."""
    if isinstance(value, int) and not isinstance(value, bool):
        if value < 1:
            raise ValueError(f"must be at least 1, or a list of seeds (got {shown(value)})")
        if value > MAX_SEEDS:
            raise ValueError(f"must be at most {MAX_SEEDS:,} (got {shown(value)})")
        return tuple(range(value))
    if isinstance(value, list) and len(value) > MAX_SEEDS:
        raise ValueError(f"must be at most {MAX_SEEDS:,} (got a list of {len(value):,})")
    return tuple(value) if isinstance(value, list) else value


Seed = Annotated[int, Field(ge=0, le=MAX_SEED)]
Seeds = Annotated[
    tuple[Seed, ...],
    BeforeValidator(
        _seeds,
        json_schema_input_type=Annotated[int, Field(ge=1, le=MAX_SEEDS)]
        | Annotated[list[Seed], Field(min_length=1, max_length=MAX_SEEDS)],
    ),
    Field(min_length=1),
]
