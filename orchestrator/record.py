"""The record of one ended cell: what it was, what came of it, and what it was made with."""

from __future__ import annotations

import json
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from trainables import curve
from trainables.cell import Cell
from trainables.errors import InputError, from_validation

SCHEMA = 1


class Record(BaseModel):
    """One file of a sweep's `cells` folder."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, arbitrary_types_allowed=True)

    cell: Cell
    status: Literal["done", "failed"]
    error: str | None = None
    """Why it failed, in a sentence."""
    points: dict[str, list[float | int | None]]
    """The evaluation curve as columns; of a failed cell, as far as it went."""
    digest: str
    """`curve.digest(points)`: tells a damaged file, and two curves apart."""
    finished: float
    """Seconds since 1970."""
    seconds: float
    """Seconds that the cell took."""
    versions: dict[str, str]
    commit: str

    @property
    def returns(self) -> list[float]:
        """The greedy returns of the evaluation curve."""
        return [float(value) for value in self.points["greedy_return"] if value is not None]

    def to_bytes(self) -> bytes:
        """The file's contents."""
        data = {"schema": SCHEMA, **self.model_dump(exclude={"cell"}), "cell": self.cell.to_json()}
        return json.dumps(data, separators=(",", ":"), allow_nan=False).encode()

    @classmethod
    def from_bytes(cls, data: bytes, where: str) -> Record:
        """The record in `data`; InputError that starts with `where` for a damaged or foreign one."""
        remedy = "move it away and run the sweep again to recompute that cell"
        try:
            raw: Any = json.loads(data)
            if not isinstance(raw, dict) or raw.pop("schema", None) != SCHEMA:
                raise InputError(f"it is not a cell record of schema {SCHEMA}")
            raw["cell"] = Cell.from_json(raw.get("cell"))
            record = cls.model_validate(raw)
            if curve.digest(record.points) != record.digest:
                raise InputError("its numbers do not agree with its checksum")
        except ValidationError as error:
            raise InputError(f"{where} is damaged ({from_validation('record', error)}): {remedy}") from None
        except ValueError as error:
            raise InputError(f"{where} is damaged ({error}): {remedy}") from None
        return record
