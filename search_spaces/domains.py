"""The values of a hyperparameter in a search space: one value, a list, or a range."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, model_validator

Scalar = float | int | str | bool


class Strict(BaseModel):
    """Data that refuses unknown keys and never reads a number from text. The strings below fields are in the schema."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True)


class Grid(Strict):
    """Values to try, each with every other hyperparameter's."""

    values: Annotated[tuple[Scalar, ...], Field(min_length=1, strict=False)]
    paper: str | None = None
    """Where the numbers come from, e.g. "Table 4"."""


class Range(Strict):
    """An interval to search with `search: {method: random | optuna}`."""

    low: float
    high: float
    log: bool = False
    """Draw on a logarithmic scale."""
    integer: bool = False
    """Whole numbers, both ends included."""
    paper: str | None = None

    def ends(self) -> tuple[Scalar, Scalar]:
        """Return the two ends, as the type that is drawn."""
        return (int(self.low), int(self.high)) if self.integer else (self.low, self.high)

    @model_validator(mode="after")
    def _ordered(self) -> Range:
        if not self.low < self.high:
            raise ValueError(f"low must be less than high ({self.low:g} and {self.high:g})")
        if self.log and self.low <= 0:
            raise ValueError(f"low must be greater than 0 on a logarithmic scale ({self.low:g})")
        return self


def _read(value: Any, info: ValidationInfo) -> Any:
    """Read a bare value or list as a grid, an object with `low` as a range."""
    if isinstance(value, Grid | Range):
        return value
    if isinstance(value, dict):
        return Range.model_validate(value) if "low" in value or "high" in value else Grid.model_validate(value)
    return Grid(values=tuple(value) if isinstance(value, list) else (value,))


Options = Annotated[
    Grid | Range,
    BeforeValidator(_read, json_schema_input_type=Scalar | Annotated[list[Scalar], Field(min_length=1)] | Grid | Range),
]
