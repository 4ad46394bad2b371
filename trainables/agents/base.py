"""The base class of all hyperparameters, and types for their ranges."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field

Rate = Annotated[float, Field(gt=0, le=1, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1, le=1_000_000_000)]


class Hyperparameters(BaseModel):
    """The hyperparameters that every agent has. Unknown keys and wrong types are refused; text is no number.

    The string below a field says what it means (`search_spaces.field_docs`).
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, defer_build=True)

    unwritten: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    """Hyperparameters added later, with the value that earlier cells had, which a cell's JSON omits."""

    episodes: Count = 1000
    """Training episodes (Table 4)."""
    evaluate_every: Count = 10
    """Episodes between greedy evaluations. There is one before training, and one after the last episode."""
    gamma: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] = 0.99
    """Discount factor (Table 4)."""

    @property
    def fixed_length(self) -> str:
        """Why training depends on `episodes` from its first step on, as a clause; empty where it does not.

        Where it does, a cell of more episodes starts anew, and does not continue a shorter one.
        """
        return ""
