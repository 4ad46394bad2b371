"""Figures that are made but not drawn, here or in a process of its own, for tests whose subject they are not."""

from __future__ import annotations

import base64
import contextlib
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

ROOT = str(Path(__file__).parents[1])

DRAWN_SMALL = ("-c", f"import sys; sys.path.append({ROOT!r}); from tests.small_figures import main; main()")
"""Arguments of Python for a `deltatune` with small figures."""


PIXEL = base64.b64decode("iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNgAAAAAgABSK+kcQAAAABJRU5ErkJggg==")
"""A PNG."""


def _save(_: Any, folder: Path, name: str) -> list[Path]:
    folder.mkdir(exist_ok=True)
    paths = [folder / f"{name}.png", folder / f"{name}.svg"]
    paths[0].write_bytes(PIXEL)
    paths[1].write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
    return paths


@contextlib.contextmanager
def small_figures() -> Iterator[None]:
    """Write a pixel in place of each figure: to draw them takes most of the time that a report takes."""
    from dashboards.renderers import drawing_process, matplotlib_renderer

    here = mock.patch.object(drawing_process.DrawingProcess, "start")
    with mock.patch.object(matplotlib_renderer, "_save", _save), here:
        yield


def main() -> None:
    """`deltatune` with small figures, which obeys Ctrl-C also where the tests run in the background of a shell."""
    from deltatune.cli.main import main

    signal.signal(signal.SIGINT, signal.default_int_handler)
    with small_figures():
        main()
