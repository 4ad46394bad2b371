"""A process that draws figures as files beside this one, which can use another core meanwhile.

Whatever goes wrong with it, the figure is drawn in this process instead, with the same bytes.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType

from dashboards import style
from dashboards.figure_model import Absent, Chart, Figure
from orchestrator.child_process import ChildProcess
from trainables.collector import collect_seldom

_MAIN = "from dashboards.renderers.drawing_process import main; main()"

Drawn = Callable[[], list[Path]]
"""Waits until a figure is drawn, and returns its files."""


@dataclass(frozen=True)
class _Order:
    """A figure to draw."""

    figure: Figure
    sweep: str
    folder: Path
    looks: Mapping[str, str]
    """The names of its agents' looks."""


class DrawingProcess:
    """Draws figures from `start` to the end of the block, one after the other, in their order."""

    def __init__(self) -> None:
        self._process: ChildProcess | None = None
        self._over, self._lock = False, threading.Lock()

    def __enter__(self) -> DrawingProcess:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._lock:
            process, self._process, self._over = self._process, None, True
        if process is not None:
            process.end()

    def start(self) -> None:
        """Start the process, which imports what it needs, unless the block has ended: another thread may call this.

        Raises OSError where there can be none.
        """
        with self._lock:
            if not self._over:
                self._process = ChildProcess.start(_MAIN)

    def draw(self, figure: Figure, sweep: str, folder: Path) -> Drawn:
        """Begin to draw a figure, as `matplotlib_renderer.draw` does; without a process it is drawn by the waiting."""
        if isinstance(figure, Absent):
            return list
        process, order = self._process, _Order(figure, sweep, folder, _looks(figure))
        if process is None:
            return lambda: _draw(order)
        with contextlib.suppress(OSError):  # it is gone, as the answer says too
            process.connection.send(order)
        return lambda: _answer(process.connection) or _draw(order)


def _looks(figure: Figure) -> dict[str, str]:
    panels = figure.panels if isinstance(figure, Chart) else ()
    agents = {series.agent for panel in panels for series in panel.series}
    agents |= {level.agent for panel in panels for level in panel.levels if level.agent}
    return {agent: style.key(agent) for agent in agents}


def _answer(connection: Connection) -> list[Path] | None:
    """Return the files of the next figure, or None where it could not be drawn there."""
    try:
        files: list[Path] | None = connection.recv()
    except (EOFError, OSError):
        return None
    return files


def _draw(order: _Order) -> list[Path]:
    from dashboards.renderers import matplotlib_renderer

    return matplotlib_renderer.draw(order.figure, order.sweep, order.folder)


def main() -> None:
    """Draw the figures that arrive on the socket, whose descriptor is the first argument, until it closes."""
    collect_seldom()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that waits handles Ctrl-C
    from PIL import Image

    import_module("dashboards.renderers.matplotlib_renderer")
    Image.preinit()
    connection = Connection(int(sys.argv[1]))
    with contextlib.suppress(EOFError, OSError):
        while True:
            order: _Order = connection.recv()
            style.fix(order.looks)
            try:
                files: list[Path] | None = _draw(order)
            except Exception:  # occurs again, and is reported, where the figure is awaited
                files = None
            connection.send(files)
