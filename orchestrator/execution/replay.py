"""Replay: one recorded cell is trained again in this process, and every bit of its curve compared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from orchestrator.errors import SweepError
from orchestrator.results.records.record import Record
from orchestrator.results.sweep_folder import Results
from orchestrator.sources.library import SourceLibrary
from trainables import curve
from trainables.errors import InputError
from trainables.knowledge import Knowledge
from trainables.numerics.threads import one_thread
from trainables.training.source_knowledge import source_knowledge
from trainables.training.train import Training, train

if TYPE_CHECKING:
    from orchestrator.dataset.dataset import Dataset


@dataclass(frozen=True)
class Replay:
    """The comparison of a recorded curve with a new one."""

    cell_id: str
    sweep: str
    agent: str
    task: str
    seed: int
    points: int
    agrees: bool
    """Whether every bit of the two curves agrees."""
    first_difference: str | None
    """The first number that differs, as text."""


def find(storage: Path, cell_id: str, sweep: str | None = None) -> Results:
    """Return the sweep in `storage`, or the one named, that has a record of the cell. Raises InputError for none."""
    folders = [Results.open(storage, sweep)] if sweep else [Results(p.parent) for p in storage.glob("*/sweep.json")]
    for results in folders:
        if results.record(cell_id) is not None:
            return results
    where = f"the sweep '{sweep}'" if sweep else f"the sweeps of {storage}"
    raise InputError(f"no record of the cell {cell_id} in {where}")


def replay(storage: Path, cell_id: str, sweep: str | None = None) -> Replay:
    """Train a recorded cell again in this process, and compare. Raises InputError for an unknown or failed cell."""
    results = find(storage, cell_id, sweep)
    record = results.record(cell_id)
    if record is None or record.status != "done":
        raise InputError(f"the cell {cell_id} has failed ({record.error if record else 'no record'}): it has no curve")
    return _compare(record, results.name, SourceLibrary(results.storage).load)


def replay_published(dataset: Dataset, cell_id: str, storage: Path) -> Replay:
    """Train a published cell again, and first the sources that the library of `storage` lacks; nothing is written.

    Raises InputError for a cell that the dataset lacks, or whose source it lacks.
    """
    library = SourceLibrary(storage)
    names = dataset.cells.loc[dataset.cells["cell_id"] == cell_id, "sweep"]

    def load(source: str) -> Knowledge:
        return library.load(source) if library.has(source) else _retrained(dataset, source, load)

    record = dataset.record(cell_id)
    return _compare(record, str(names.iloc[0]), load)


def _retrained(dataset: Dataset, cell_id: str, load: Callable[[str], Knowledge]) -> Knowledge:
    """Return what a published cell learns. Raises SweepError where its curve is not the published one's."""
    record = dataset.record(cell_id)
    training, again = _again(record, load)
    if curve.digest(again) != record.digest:
        raise SweepError(f"the source {cell_id}, trained again, has another curve than the published one")
    return training.knowledge()


def _again(record: Record, load: Callable[[str], Knowledge]) -> tuple[Training, curve.Columns]:
    """Return what trained the cell of `record` again, and the curve, in the columns that the record has."""
    one_thread()
    training = train(record.cell, source_knowledge(record.cell, load) if record.cell.sources else None)
    again = curve.columns(training)
    return training, {name: column for name, column in again.items() if name in record.points}


def _compare(record: Record, sweep: str, load: Callable[[str], Knowledge]) -> Replay:
    """Train the cell of `record` again, its sources by `load`, and hold the two curves against each other."""
    cell = record.cell
    _, again = _again(record, load)
    agrees = curve.digest(again) == record.digest
    difference = None if agrees else _first_difference(record.points, again)
    return Replay(cell.id, sweep, cell.agent, cell.task, cell.seed, len(again["episode"]), agrees, difference)


def _first_difference(recorded: curve.Columns, again: curve.Columns) -> str:
    for name in (name for name in recorded if name != "seconds"):
        for point, (old, new) in enumerate(zip(recorded[name], again.get(name, ()), strict=False)):
            if old != new:
                return f"{name} at episode {recorded['episode'][point]}: {old!r} was recorded, {new!r} came now"
    return "the curves have different lengths or columns"
