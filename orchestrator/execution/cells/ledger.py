"""The ledger of a running sweep: which cells are planned, which have ended, and their outcomes."""

from __future__ import annotations

import logging
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from orchestrator import clock
from orchestrator.execution.cells.longer import Places, Shorter
from orchestrator.execution.defaults import Reuse
from orchestrator.execution.settings import LIBRARY
from orchestrator.planning.arms import Arm, labels_of
from orchestrator.planning.source_choice import SourceRun
from orchestrator.results.checked_json import DamagedError
from orchestrator.results.other_sweeps import OtherSweeps
from orchestrator.results.provenance import commit, versions
from orchestrator.results.records.record import Record
from orchestrator.results.sweep_folder import Labels, Plan, Results
from orchestrator.results.tables.cell_row import cell_row
from orchestrator.sources.library import SourceLibrary
from search_spaces.search_space import SearchSpace
from trainables.cell import Cell
from trainables.curve import auc
from trainables.knowledge import Knowledge
from trainables.storage import disk
from trainables.training.end_states import FOLDER
from trainables.training.messages import Outcome

if TYPE_CHECKING:
    import pandas as pd

log = logging.getLogger("deltatune.sweep")


class Ledger:
    """Writes a sweep's records and the source library; nothing else in a driver does."""

    def __init__(
        self,
        results: Results,
        retry_failed: bool,
        space: SearchSpace | None = None,
        reads_only: bool = False,
        reuse: Reuse = "sources",
    ) -> None:
        """space: default that in the folder of `results`. reads_only: write nothing. reuse: what `take_over` takes."""
        self.library = SourceLibrary(results.storage)
        self.checkpoints, self.states = results.folder / "checkpoints", results.folder / FOLDER
        self._results = results
        self._retry_failed = retry_failed
        self._reads_only, self._reuse = reads_only, reuse
        self._others = OtherSweeps(results.storage, results.name) if reuse == "all" else None
        self._stops = (space or results.space()).search.scheduler is not None
        self._heads = results.heads()
        self.damage = results.damage()
        """Damage of the records, in sentences; the cells concerned run again."""
        plan, self._labels = self._planned_before()
        self._plan = {stage: {cell.id: cell for cell in cells} for stage, cells in plan.items()}
        self._arms: dict[str, Sequence[Arm]] = {}
        self._new: set[str] = set()
        self._whole: set[str] = set()
        """Cells whose knowledge in the library was verified."""
        self._spared: frozenset[str] = frozenset()

    def _planned_before(self) -> tuple[Plan, dict[str, Labels]]:
        """Return the plan and labels of the previous run; empty where they are damaged."""
        try:
            return self._results.plan(), self._results.labels()
        except DamagedError as error:
            self.damage.append(str(error))
            return {}, {}

    def plan(self, stage: str, cells: Iterable[Cell], arms: Sequence[Arm] | None = None) -> list[Cell]:
        """Record the cells of a stage, each once, and their arms (default: those of the previous call)."""
        self._plan[stage] = {cell.id: cell for cell in cells}
        if arms is not None:
            self._arms[stage] = arms
        if stage in self._arms:
            self._labels[stage] = labels_of(self._arms[stage], self.planned(stage))
        self._results.set_plan({name: list(planned.values()) for name, planned in self._plan.items()}, self._labels)
        return self.planned(stage)

    def forget(self, stages: Iterable[str]) -> None:
        """Take stages out of the plan that are no longer asked for; the records of their cells stay."""
        asked = [stage for stage in stages if stage in self._plan]
        for stage in asked:
            del self._plan[stage]
            self._labels.pop(stage, None)
        if asked:
            self._results.set_plan({name: list(there.values()) for name, there in self._plan.items()}, self._labels)

    def planned(self, stage: str) -> list[Cell]:
        """Return the cells of a stage known so far, those suggested by a search included."""
        return list(self._plan.get(stage, {}).values())

    def take_over(self, stage: str, cells: Iterable[Cell], keep: bool) -> dict[str, int]:
        """Copy the records of cells that have ended elsewhere in this storage; return how many came from where.

        keep: only sources whose knowledge is in the library count. Cells that have a record here are left alone.
        """
        found = [
            each for cell in cells if cell.id not in self._heads and (each := self._elsewhere(cell, keep)) is not None
        ]
        records = [record for _, record in found]
        if self._reads_only:
            self._heads = {**self._heads, **{record.cell.id: record.head for record in records}}
        elif records:
            self._results.add(*records)
            self._plan.setdefault(stage, {}).update({record.cell.id: record.cell for record in records})
        return dict(Counter(origin for origin, _ in found))

    def _elsewhere(self, cell: Cell, keep: bool) -> tuple[str, Record] | None:
        """Return (where it is, the record) of a cell that another sweep of this storage has finished."""
        if not keep:
            return self._others.find(cell) if self._others else None
        record = self.library.record(cell.id) if self._reuse != "none" and self._has_source(cell) else None
        return (LIBRARY, record) if record is not None and record.status == "done" else None

    def ended(self, cell: Cell, keep: bool = False) -> bool:
        """Return whether the cell need not run any more. keep: its knowledge must be in the library too."""
        head = self._heads.get(cell.id)
        if head is None:
            return False
        if head.status == "failed":
            return cell.id in self._new or not self._retry_failed
        if head.status == "stopped":
            return self._stops  # without a scheduler the cell has to be trained to its end
        return not keep or cell.id in self._spared or self._has_source(cell)

    def spare(self, cell_ids: Iterable[str]) -> int:
        """Take those of these sources that the library has not for ended by their records; return how many."""
        self._spared = frozenset(cell_id for cell_id in cell_ids if not self.library.has(cell_id))
        return len(self._spared)

    def _has_source(self, cell: Cell) -> bool:
        """Return whether the library has a cell's knowledge undamaged; an intact one is verified only once."""
        if cell.id not in self._whole and self.library.has(cell.id):
            if damage := self.library.damage(cell.id):
                log.warning("%s: the cell trains again", damage.partition(": move it away")[0])
                return False
            self._whole.add(cell.id)
        return cell.id in self._whole

    def new(self, cell: Cell) -> bool:
        """Return whether the cell has ended in this run."""
        return cell.id in self._new

    def source_run(self, cell: Cell) -> SourceRun:
        """Return what stage 2 needs to know about a done cell of stage 1."""
        summary = self._heads[cell.id].summary
        return SourceRun(cell, float(summary["best_return"] or 0), self._auc(cell), int(summary["steps"] or 0))

    def source_runs(self, arm: Arm) -> dict[int, SourceRun]:
        """Return the source runs of an arm of one configuration by seed, of the seeds that are done."""
        return {cell.seed: self.source_run(cell) for cell in arm.all_cells() if self.score([cell]) is not None}

    def score(self, cells: Sequence[Cell]) -> float | None:
        """Return the mean AUC of a configuration's cells; None where one is not done."""
        heads = [self._heads.get(cell.id) for cell in cells]
        if not all(head is not None and head.status == "done" for head in heads):
            return None
        return auc([self._auc(cell) for cell in cells])

    def scores(self, arm: Arm) -> list[list[float]]:
        """Return for each finished configuration of an arm the mean greedy return up to each evaluation."""
        groups: dict[str, list[Cell]] = defaultdict(list)
        for head in self._heads.values():
            if head.status in ("done", "stopped") and arm.owns(head.cell):
                groups[head.cell.group].append(head.cell)
        return [self._means(cells) for cells in groups.values()]

    def take(self, stage: str, outcomes: Sequence[Outcome]) -> list[Record]:
        """Write the outcomes of cells to disk, first their knowledge, then their records; return the records.

        A cell that is already done is skipped: a trial restarted after a lost worker reports it a second time.
        """
        records = []
        for outcome in outcomes:
            cell = outcome.cell
            if cell.id in self._new and self._heads[cell.id].status == "done":
                continue
            record = record_of(outcome)
            if outcome.knowledge is not None:
                self.library.save(cell, Knowledge.from_bytes(outcome.knowledge)[0], record)
            records.append(record)
        if records:
            self._results.add(*records)
        for record in records:
            disk.remove(self.checkpoints / f"{record.cell.id}.checkpoint")
            self._new.add(record.cell.id)
            self._plan[stage][record.cell.id] = record.cell
        return records

    def shorter(self) -> Shorter:
        """Return the cells that have ended, with their end states, for longer ones to continue."""
        return Shorter(self._heads, self.states, self._others)

    def drop_outgrown(self, stage: str, known: Places) -> None:
        """Remove the end states that a stage has continued, where those of the longer cells are there. Best effort."""
        for path in self.shorter().outgrown(self.planned(stage), known):
            try:
                disk.remove(path)
            except Exception as error:  # each protocol's package raises different errors
                log.warning("the end state %s cannot be removed: %s", path, error)
                return

    def searched(self, arm: Arm) -> list[Cell]:
        """Return the cells that a search of this arm has suggested in earlier runs."""
        return [head.cell for head in self._heads.values() if arm.owns(head.cell)]

    def table(self, cells: Iterable[Cell], stage: str) -> pd.DataFrame:
        """Return the cells table of some cells."""
        import pandas as pd

        return pd.DataFrame([cell_row(stage, cell, self._heads.get(cell.id)) for cell in cells])

    def close(self) -> None:
        """Merge what this run has appended, and drop damaged records, whose cells have run again or are missing."""
        self._results.log.compact()

    def _auc(self, cell: Cell) -> float:
        return float(self._heads[cell.id].summary["auc"] or 0)

    def _means(self, cells: Iterable[Cell]) -> list[float]:
        curves = [record.returns for cell in cells if (record := self._results.log.record(cell.id))]
        length = min(map(len, curves))
        return [auc([auc(returns[:stop]) for returns in curves]) for stop in range(1, length + 1)]


def record_of(outcome: Outcome) -> Record:
    """Return the record of a cell that has ended now."""
    fields = {name: getattr(outcome, name) for name in ("cell", "status", "error", "points", "digest", "seconds")}
    return Record(finished=clock.time(), versions=versions(), commit=commit(), **fields)
