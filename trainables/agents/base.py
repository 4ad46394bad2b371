"""What the hyperparameters of every agent have, and the ranges that they are made of."""

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
    """What every agent has. Wrong keys and types are refused; numbers are not read from text."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, use_attribute_docstrings=True)

    unwritten: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    """What a cell's JSON leaves out: of a hyperparameter younger than recorded cells, the value that these had."""

    episodes: Count = 1000
    """Training episodes (Table 4)."""
    evaluate_every: Count = 10
    """Episodes between greedy evaluations; one is made before training and one after the last episode."""
    gamma: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)] = 0.99
    """Discount factor (Table 4)."""
