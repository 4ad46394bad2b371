"""What a running sweep says in the terminal."""

from __future__ import annotations

import io
import itertools
from pathlib import Path

import pytest
from rich.console import Console

from orchestrator.execution.display import COMPILING, Display
from trainables.training.messages import Progress


@pytest.mark.parametrize("terminal", [True, False])
def test_whoever_waits_for_the_compiler_is_told_so_once_in_a_sweep(terminal: bool, tmp_path: Path) -> None:
    console = Console(file=io.StringIO(), width=80, force_terminal=terminal, color_system=None)
    said: set[str] = set()
    for stage in ("source", "transfer"):
        with Display(console, stage, 4, tmp_path, said=said) as display:
            for _worker in range(2):
                display.compiling()
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert text.count(COMPILING) == 1
    assert len(COMPILING) <= 80


def test_the_live_line_says_compiling_until_a_cell_reports(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    console = Console(file=io.StringIO(), width=80, force_terminal=True, color_system=None)
    monkeypatch.setattr("orchestrator.execution.display.time.monotonic", itertools.count().__next__)

    def line() -> str:
        with console.capture() as capture:
            console.print(display._bars.get_renderable())
        return capture.get()

    with Display(console, "source", 4, tmp_path) as display:
        display.running(2)
        assert "compiling" not in line()
        display.compiling()
        display.running(2)
        assert "2 running" in line()
        assert "compiling" in line()
        display.progress(Progress("cell", 0.1, 10, 0.0))
        assert "compiling" not in line()
