"""What a running sweep knows of its cells: which are planned, which have ended, and what came of them."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from typing import Any

import pandas as pd

from orchestrator.plan import Pair, SourceRun
from orchestrator.provenance import commit, versions
from orchestrator.record import Record
from orchestrator.results import Results, cell_row
from orchestrator.source_library import SourceLibrary
from trainables.cell import Cell
from trainables.curve import auc
from trainables.knowledge import Knowledge


class Ledger:
    """The one writer of a sweep's records and of the source library."""

    def __init__(self, results: Results, retry_failed: bool) -> None:
        self.library = SourceLibrary(results.storage)
        self.checkpoints = results.folder / "checkpoints"
        self._results = results
        self._retry_failed = retry_failed
        self._plan = {stage: {cell.id: cell for cell in cells} for stage, cells in results.plan().items()}
        self._records: dict[str, Record | None] = {}
        self._new: set[str] = set()

    def plan(self, stage: str, cells: Iterable[Cell]) -> list[Cell]:
        """Write down the cells of a stage; each once."""
        self._plan[stage] = {cell.id: cell for cell in cells}
        self._results.set_plan({name: list(planned.values()) for name, planned in self._plan.items()})
        return self.planned(stage)

    def planned(self, stage: str) -> list[Cell]:
        """The cells of a stage as known now, those that a search has asked for included."""
        return list(self._plan[stage].values())

    def record(self, cell: Cell) -> Record | None:
        """The cell's record, None where it has not ended; InputError where it is damaged."""
        if cell.id not in self._records:
            self._records[cell.id] = self._results.record(cell.id)
        return self._records[cell.id]

    def ended(self, cell: Cell, keep: bool = False) -> bool:
        """Whether there is nothing more to run. `keep`: the cell's knowledge must be in the library too."""
        record = self.record(cell)
        if record is None:
            return False
        if record.status == "failed":
            return cell.id in self._new or not self._retry_failed
        return not keep or self.library.has(cell.id)

    def new(self, cell: Cell) -> bool:
        """Whether the cell has ended in this run."""
        return cell.id in self._new

    def source_run(self, cell: Cell) -> SourceRun:
        """What stage 2 needs to know of a done cell of stage 1."""
        record = self.record(cell)
        assert record is not None
        steps = record.points["step"][-1]
        return SourceRun(cell, max(record.returns), auc(record.returns), int(steps or 0))

    def score(self, cells: Sequence[Cell]) -> float | None:
        """Mean AUC of a configuration's cells; None where one is not done."""
        records = [self.record(cell) for cell in cells]
        aucs = [auc(record.returns) for record in records if record is not None and record.status == "done"]
        return auc(aucs) if len(aucs) == len(cells) else None

    def take(self, stage: str, outcome: dict[str, Any]) -> Record | None:
        """Put the outcome of a cell on disk: first what it has learned, then its record.

        None where the cell is done already, which a trial that was started again after its worker was lost tells
        a second time.
        """
        cell = Cell.from_json(outcome.pop("cell"))
        before = self._records.get(cell.id)
        if cell.id in self._new and before is not None and before.status == "done":
            return None
        knowledge: bytes | None = outcome.pop("knowledge")
        if knowledge is not None:
            self.library.save(cell, Knowledge.from_bytes(knowledge)[0])
        record = Record(cell=cell, finished=time.time(), versions=versions(), commit=commit(), **outcome)
        self._results.add(record)
        (self.checkpoints / f"{cell.id}.checkpoint").unlink(missing_ok=True)
        self._records[cell.id] = record
        self._new.add(cell.id)
        self._plan[stage][cell.id] = cell
        return record

    def searched(self, pair: Pair) -> list[Cell]:
        """The cells that a search of this pair has asked for in earlier runs."""
        return [r.cell for r in self._results.every_record() if pair.owns(r.cell)]

    def table(self, cells: Iterable[Cell], stage: str) -> pd.DataFrame:
        """The cells table of some cells."""
        return pd.DataFrame([cell_row(stage, cell, self.record(cell)) for cell in cells])
