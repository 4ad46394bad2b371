"""Seeds in a search space: a list of them, how many, or as many as a sequential test asks for."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, ValidationError

from search_spaces.domains import Strict
from search_spaces.limits import MAX_SEED, MAX_SEEDS
from trainables.errors import from_validation, shown


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


def _sweep_seeds(value: object) -> object:
    """Return the same for the seeds of a sweep."""
    if isinstance(value, str):
        raise ValueError(f"must be a number, a list of seeds, or auto (got {shown(value)})")
    return _seeds(value)


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

AUTO_SEEDS = 30
"""Most seeds of `seeds: auto`."""


class Sequential(Strict):
    """A sequential test over seeds (AdaStop): the seeds run group after group until every comparison is decided.

    Each target task has its family of comparisons: every agent against those that it builds on.
    """

    group: Annotated[int, Field(ge=2, le=MAX_SEEDS)] = 5
    """Seeds of a group, after which the comparisons are tested."""
    alpha: Annotated[float, Field(gt=0, lt=1)] = 0.05
    """Probability of one wrong decision or more among the comparisons on a target: the family-wise error."""


class Auto(Sequential):
    """The same as it is written under `seeds`, with the budget."""

    max: Annotated[int, Field(ge=2, le=MAX_SEEDS)] = AUTO_SEEDS
    """Most seeds of a configuration, a multiple of `group`."""


class AutoSeeds(Strict):
    """As many seeds as a sequential test asks for."""

    auto: Auto


SweepSeeds = Annotated[
    tuple[Seed, ...],
    BeforeValidator(
        _sweep_seeds,
        json_schema_input_type=Literal["auto"]
        | Annotated[int, Field(ge=1, le=MAX_SEEDS)]
        | Annotated[list[Seed], Field(min_length=1, max_length=MAX_SEEDS)]
        | AutoSeeds,
    ),
    Field(min_length=1),
]
"""Seeds of a sweep; `spelled_out` has replaced `auto` by the most seeds that it may take."""


def spelled_out(data: object) -> object:
    """Return a search space's data with `seeds: auto` as the list of all seeds, and the test as `sequential`."""
    seeds = data.get("seeds") if isinstance(data, dict) else None
    if not isinstance(data, dict) or not (seeds == "auto" or isinstance(seeds, dict)):
        return data
    try:
        auto = Auto() if seeds == "auto" else AutoSeeds.model_validate(seeds).auto
    except ValidationError as error:
        raise from_validation("seeds", error) from None
    if data.get("sequential"):
        raise ValueError("seeds: auto says how the seeds are tested, and sequential says it again: leave one out")
    sequential = {"group": auto.group, "alpha": auto.alpha}
    return {**data, "seeds": auto.max, "sequential": sequential}
