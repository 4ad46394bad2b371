"""Running one recorded cell again in the plain process, to see whether every bit of its curve agrees."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from orchestrator.results.sweep_folder import Results
from orchestrator.sources.library import SourceLibrary
from trainables import curve
from trainables.errors import InputError
from trainables.numerics.threads import one_thread
from trainables.training.train import source_knowledge, train


@dataclass(frozen=True)
class Replay:
    """What came of running a cell again."""

    cell_id: str
    sweep: str
    agent: str
    task: str
    seed: int
    points: int
    agrees: bool
    """Whether every bit of the curve is the recorded one's."""
    first_difference: str | None
    """The first number that differs, in words."""


def find(storage: Path, cell_id: str, sweep: str | None = None) -> Results:
    """The sweep in `storage` (or the one named) that has a record of the cell; InputError where none has."""
    folders = [Results.open(storage, sweep)] if sweep else [Results(p.parent) for p in storage.glob("*/sweep.json")]
    for results in folders:
        if results.record(cell_id) is not None:
            return results
    where = f"the sweep '{sweep}'" if sweep else f"the sweeps of {storage}"
    raise InputError(f"no record of the cell {cell_id} in {where}")


def replay(storage: Path, cell_id: str, sweep: str | None = None) -> Replay:
    """Train a recorded cell again here, without Ray, and compare. InputError for an unknown or a failed cell."""
    results = find(storage, cell_id, sweep)
    record = results.record(cell_id)
    if record is None or record.status != "done":
        raise InputError(f"the cell {cell_id} has failed ({record.error if record else 'no record'}): it has no curve")
    one_thread()
    cell = record.cell
    source = source_knowledge(cell, SourceLibrary(results.storage).load) if cell.sources else None
    again = curve.columns(train(cell, source))
    agrees = curve.digest(again) == record.digest
    difference = None if agrees else _first_difference(record.points, again)
    return Replay(cell_id, results.name, cell.agent, cell.task, cell.seed, len(again["episode"]), agrees, difference)


def _first_difference(recorded: curve.Columns, again: curve.Columns) -> str:
    for name in (name for name in recorded if name != "seconds"):
        for point, (old, new) in enumerate(zip(recorded[name], again.get(name, ()), strict=False)):
            if old != new:
                return f"{name} at episode {recorded['episode'][point]}: {old!r} was recorded, {new!r} came now"
    return "the curves have different lengths or columns"
