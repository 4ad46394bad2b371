"""Figures drawn in a process of their own have the bytes of those drawn here, whatever becomes of the process."""

from __future__ import annotations

from pathlib import Path

import pytest

from dashboards import style
from dashboards.figure_model import Absent, Chart, Figure, Level, Panel, Series
from dashboards.renderers import drawing_process, matplotlib_renderer
from dashboards.renderers.drawing_process import DrawingProcess

HERE = "mine.py:Agent"
"""A custom agent whose code only this process has."""


def chart(name: str, ticks: tuple[str, ...] = ()) -> Chart:
    agents = ("q_learning", HERE)
    lines = tuple(Series(agent, agent, (0.0, 1.0), (0.0, number + 1.0)) for number, agent in enumerate(agents))
    levels = (Level(0.5, "source", HERE),)
    return Chart(name, name, "", "", (Panel(name, "x", "y", lines, levels=levels, x_ticks=ticks),))


@pytest.fixture(autouse=True)
def looks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(style, "_FIXED", {HERE: "wine"})


def kill(artist: DrawingProcess) -> None:
    assert artist._process is not None
    artist._process.process.kill()
    artist._process.process.wait()


def drawn(artist: DrawingProcess, figures: list[Figure], folder: Path) -> list[bytes]:
    folder.mkdir()
    begun = [artist.draw(figure, "sweep", folder) for figure in figures]
    return [path.read_bytes() for files in begun for path in files()]


def test_the_bytes_are_those_of_a_figure_drawn_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures: list[Figure] = [chart("one"), Absent("none", "None", "There is none."), chart("two", ("a", "b"))]
    here = drawn(DrawingProcess(), figures, tmp_path / "here")
    assert len(here) == 4
    with DrawingProcess() as artist:
        artist.start()
        monkeypatch.setattr(drawing_process, "_draw", lambda order: [])  # here
        monkeypatch.setattr(matplotlib_renderer, "draw", lambda *words: [])
        assert drawn(artist, figures, tmp_path / "there") == here


def test_what_fails_there_is_drawn_here_or_fails_here(tmp_path: Path) -> None:
    broken = Chart("broken", "broken", "", "", (), 2)
    with DrawingProcess() as artist:
        artist.start()
        good, bad, last = (artist.draw(each, "sweep", tmp_path) for each in (chart("one"), broken, chart("two")))
        assert len(good()) == 2
        with pytest.raises(ValueError, match="empty"):
            bad()
        assert [path.name for path in last()] == ["two.png", "two.svg"]


@pytest.mark.parametrize("when", ["before", "after"])
def test_a_process_that_is_killed_costs_no_figure(tmp_path: Path, when: str) -> None:
    with DrawingProcess() as artist:
        artist.start()
        if when == "before":
            kill(artist)
        files = artist.draw(chart("one"), "sweep", tmp_path)
        if when == "after":
            kill(artist)
        assert [path.name for path in files()] == ["one.png", "one.svg"]
    assert artist._process is None


def test_a_process_asked_for_too_late_is_not_started() -> None:
    with DrawingProcess() as artist:
        pass
    artist.start()
    assert artist._process is None
