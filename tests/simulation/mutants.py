"""Mistakes that a person could make in the driver's code: the simulation must find each of them."""

from __future__ import annotations

import contextlib
import inspect
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any
from unittest import mock

from orchestrator.execution import work_queue
from orchestrator.execution.cells import ledger
from orchestrator.results import lock
from orchestrator.results.records import record_log
from orchestrator.sources import library
from tests.simulation.simulate import simulate, undisturbed
from trainables.storage import atomic

FAULTS = {"power loss": 0.02, "crash": 0.01, "lost worker": 0.3, "second driver": 0.9, "double outcome": 0.3}
TORN = {"torn write": 0.15}
FROZEN = {"stale lease": 0.02, "second driver": 0.9, "MLflow does not answer": 0.1}


@dataclass(frozen=True)
class Mutant:
    """One mistake."""

    what: str
    holder: Any
    """Where the function is looked up."""
    name: str
    made_in: Any
    """The module in which it is written."""
    old: str
    new: str
    faults: Mapping[str, float] = field(default_factory=FAULTS.copy)
    """Those that find it soon."""
    on_disk: bool = True

    @contextlib.contextmanager
    def made(self) -> Iterator[None]:
        """Put the mistake into the code, while the block runs."""
        real = inspect.unwrap(getattr(self.holder, self.name))
        source = textwrap.dedent(inspect.getsource(real))
        assert self.old in source, f"the code has changed: {self.what}"
        names = dict(vars(self.made_in))
        future = "from __future__ import annotations\n"
        exec(compile(future + source.replace(self.old, self.new), f"<{self.what}>", "exec"), names)
        with mock.patch.object(self.holder, self.name, names[self.name]):
            yield

    def caught_by(self, seeds: range) -> int | None:
        """Return the first seed that finds it."""
        undisturbed()
        with self.made():
            return next((seed for seed in seeds if simulate(seed, self.on_disk, dict(self.faults)).violations), None)


MUTANTS = [
    Mutant("a record is told before it is synchronised", record_log, "append", atomic, "disk.sync(file)", "pass"),
    Mutant(
        "a source takes its name before it is synchronised", library, "write_atomic", atomic, "disk.sync(file)", "pass"
    ),
    Mutant("the name of a new segment is not synchronised", record_log, "append", atomic, "if not start:", "if False:"),
    Mutant(
        "a record is written before what its cell has learned",
        ledger.Ledger,
        "take",
        ledger,
        "        if outcome.knowledge is not None:\n"
        "            self.library.save(cell, Knowledge.from_bytes(outcome.knowledge)[0], record)\n"
        "        records.append(record)\n"
        "    if records:\n"
        "        self._results.add(*records)\n",
        "        records.append(record)\n"
        "    if records:\n"
        "        self._results.add(*records)\n"
        "    for outcome, record in zip(outcomes, records):\n"
        "        if outcome.knowledge is not None:\n"
        "            self.library.save(outcome.cell, Knowledge.from_bytes(outcome.knowledge)[0], record)\n",
    ),
    Mutant(
        "a cell whose worker was lost is forgotten",
        work_queue.WorkQueue,
        "on_lost",
        work_queue,
        "self.packs += [Pack((cell,)) for cell in left]",
        "pass",
    ),
    Mutant(
        "a new driver appends to the last segment, torn as it may be",
        record_log.RecordLog,
        "_next",
        record_log,
        "self._number += 1",
        "self._number = max(self._number, 0)",
        TORN,
    ),
    Mutant(
        "who was frozen on a lease writes on into MLflow, without looking",
        lock.Hold,
        "check_surely",
        lock,
        "self.verify()",
        "pass",
        FROZEN,
        on_disk=False,
    ),
    Mutant(
        "a lease that is gone is taken for the own one, however long nobody has signed it",
        lock.Hold,
        "verify",
        lock,
        "there = {} if self._overdue() else self.who",
        "there = self.who",
        FROZEN,
        on_disk=False,
    ),
    Mutant("nobody takes the lock", lock, "_file_lock", lock, "lock.acquire(timeout=0)", "pass"),
    Mutant(
        "an outcome that comes twice is recorded twice",
        ledger.Ledger,
        "take",
        ledger,
        'if cell.id in self._new and self._heads[cell.id].status == "done":',
        "if False:",
    ),
    Mutant(
        "a lease is taken from a driver that lives",
        lock,
        "_lease",
        lock,
        "if before and (_alive(before) or _changes(folder, file, before)):",
        "if False:",
        on_disk=False,
    ),
]
