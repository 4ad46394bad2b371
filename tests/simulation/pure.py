"""What the driver computes from its arguments alone, worked out once: most of a seed's time would go there."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Hashable, Iterable, Iterator
from types import SimpleNamespace
from typing import Any

from orchestrator.analysis import groups, selection
from orchestrator.execution import session, stage, sweep
from orchestrator.execution.cells.ledger import Ledger
from orchestrator.results import sweep_folder
from orchestrator.results.records import record_log
from orchestrator.sources import library
from trainables.cell import Cell, Source
from trainables.knowledge import Knowledge

MOST = 5000
"""Results that are remembered of each function."""

Patch = tuple[Any, str, Any]
"""(holder, name, what takes its place)."""


def remembered(function: Callable[..., Any], key: Callable[..., Hashable] = lambda *words: words) -> Any:
    """Return `function`, called once for each key of its arguments."""
    known: dict[Hashable, Any] = {}

    def remembering(*words: Any, **more: Any) -> Any:
        name = key(*words, **more)
        if name not in known:
            if len(known) >= MOST:
                known.clear()
            known[name] = function(*words, **more)
        return known[name]

    return remembering


def _cell(agent: str, task: str, seed: int, values: object = None, source: Source | Iterable[Source] = ()) -> Hashable:
    sources = (source,) if isinstance(source, Source) else tuple(source or ())
    return agent, task, seed, repr(values), sources


_json: dict[int, tuple[Cell, dict[str, Any]]] = {}
_to_json = Cell.to_json


def _cell_json(cell: Cell) -> dict[str, Any]:
    if len(_json) > MOST:
        _json.clear()
    if id(cell) not in _json:
        _json[id(cell)] = cell, _to_json(cell)  # which keeps the cell, and so its number
    return dict(_json[id(cell)][1])


def _outcomes(table: Any, same: Any) -> Hashable:
    return tuple(table["cell_id"]), tuple(table["status"])


def _statuses(ledger: Ledger, cells: Iterable[Cell], stage: str) -> Hashable:
    heads = ledger._heads
    return stage, tuple((cell.id, heads[cell.id].status if cell.id in heads else "") for cell in cells)


@contextlib.contextmanager
def _unlogged(folder: object) -> Iterator[None]:
    yield


class _NoDisplay:
    """Shows nothing."""

    def __init__(self, *words: object) -> None:
        pass

    def __enter__(self) -> _NoDisplay:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def _ignore(self, *words: object) -> None:
        pass

    ended = progress = over = running = abandon = _ignore


_select, _groups = selection.select, groups.groups

PURE: tuple[Patch, ...] = (
    (Cell, "create", staticmethod(remembered(Cell.create, _cell))),
    (Cell, "to_json", _cell_json),
    (Knowledge, "from_bytes", staticmethod(remembered(Knowledge.from_bytes))),
    (library, "_entry", remembered(library._entry)),
    (record_log, "read_head", remembered(record_log.read_head)),
    (record_log, "read_record", remembered(record_log.read_record)),
    (sweep_folder, "parse", remembered(sweep_folder.parse, lambda where, data: repr(data))),
    (sweep, "source_arms", remembered(sweep.source_arms, lambda space, params: (id(space), repr(params)))),
    (groups, "groups", lambda table: table),  # the statistics are no subject here, and slow
    (selection, "select", remembered(lambda table, same: _select(_groups(table), table), _outcomes)),
    (Ledger, "table", remembered(Ledger.table, _statuses)),
    (stage, "Display", _NoDisplay),
    (stage, "logging_to", _unlogged),
    (session, "logging_to", _unlogged),
    (session, "threading", SimpleNamespace(Thread=lambda **words: SimpleNamespace(start=lambda: None))),
)
"""What is the same in every simulated world."""


@contextlib.contextmanager
def patched(patches: Iterable[Patch]) -> Iterator[None]:
    """Put other things in place of some, while the block runs."""
    before = []
    try:
        for holder, name, value in patches:
            before.append((holder, name, vars(holder)[name]))
            setattr(holder, name, value)
        yield
    finally:
        for holder, name, value in reversed(before):
            setattr(holder, name, value)
