"""Tables in terminals of every width: nothing is lost, nothing is wider than the terminal."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from deltatune.cli.sheet import table

COLUMNS = ("task", "agent", "source", "hyperparameters", "AUC mean (sd)", "transfer ratio [95%]")
ROWS = (
    ("windy_gridworld:wind=small", "q_learning", "none", "- (best of 4)", "-72.90 (3.50)", "-"),
    ("", "delta_gate", "learned", "threshold=10, learning_rate=0.5", "-52.40 (1.80)", "+28% [24, 32]"),
    ("windy_gridworld:wind=reversed", "delta_gate", "exact", "threshold=10", "-199.90 (0.10)", "-431% [-453, -410]"),
)


def shown(width: int) -> str:
    console = Console(file=io.StringIO(), width=width)
    console.print(table(COLUMNS, ROWS, "Best configurations"))
    return console.file.getvalue()  # type: ignore[attr-defined, no-any-return]


@pytest.mark.parametrize("width", [160, 120, 100, 80, 60])
def test_every_word_is_shown_whole_at_any_width(width: int) -> None:
    text = shown(width)
    assert max(len(line) for line in text.splitlines()) <= width
    words = text.split()
    for row in ROWS:
        assert all(word.strip(",") in " ".join(words) for cell in row for word in cell.split())


def test_a_wide_terminal_has_a_table_and_a_narrow_one_a_card_for_each_row() -> None:
    assert "────" in shown(160)
    card = shown(60)
    assert "────" not in card
    assert card.count("windy_gridworld:wind=small\n") == 1, "a task is named once"
    assert "transfer ratio [95%] +28% [24, 32]" in " ".join(card.split())
    assert "transfer ratio [95%] - " not in " ".join(card.split()), "what says nothing is left out"


def test_running_text_is_folded_before_a_table_becomes_cards() -> None:
    console = Console(file=io.StringIO(), width=60)
    console.print(table(("name", "meaning"), [("learning_rate", "the step size of every update, " * 3)]))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "────" in text
    assert len(text.splitlines()) > 4


@pytest.mark.parametrize("width", [60, 80, 120, 200])
def test_the_live_line_keeps_its_bar_and_count(width: int) -> None:
    from orchestrator.execution.display import bars, fields
    from orchestrator.results.progress import Snapshot

    snapshot = Snapshot("transfer", 108, 40, 1, 0, 2, 0, 0.4, 12_345.0, 130.0, "best AUC -36.7 (delta_gate on a task)")
    console = Console(file=io.StringIO(), width=width)
    live = bars(console)
    live.add_task(**fields(snapshot))
    console.print(live.get_renderable())
    (line,) = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert len(line) <= width
    for part in ("transfer", "━", "41/108", "40%", "about 2 min left"):
        assert part in line
    assert ("2 running, 1 failed" in line) == (width >= 80)
    assert ("12,345 steps/s" in line) == (width >= 120)
    assert ("best AUC" in line) == (width >= 140)
