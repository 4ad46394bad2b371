"""The report: one file, every section, no text of a user that becomes markup, and a bound on its size."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pandas as pd
import pytest

from dashboards.draw import draw
from dashboards.figure_model import Absent, Chart, Figure
from dashboards.renderers.plotly_renderer import specs
from dashboards.report import sections
from orchestrator.analysis.findings import Findings, find
from orchestrator.results.sweep_folder import Results
from tests.dashboards import synthetic

SECTIONS = ["verdict", "curves", "results", "contrasts", "matrix", "forest", "delta", "gate", "hyperparameters"]
SECTIONS += ["origin"]
HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)> & \"quoted\" 'too' =1+1"


class Page(HTMLParser):
    """What is in a report: tags with their attributes, the ids of sections, the text."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text: list[str] = []
        self.data = ""
        self._script: dict[str, str | None] | None = None
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._script = dict(attrs) if tag == "script" else None

    def handle_endtag(self, tag: str) -> None:
        self._script = None

    def handle_data(self, data: str) -> None:
        if self._script is None:
            self.text.append(data)
        elif self._script.get("id") == "data":
            self.data += data

    def found(self, tag: str, **attributes: str) -> list[dict[str, str | None]]:
        wanted = attributes.items()
        return [own for name, own in self.tags if name == tag and all(own.get(key) == value for key, value in wanted)]

    @property
    def sections(self) -> list[str | None]:
        return [own["id"] for own in self.found("section")]


@pytest.fixture(scope="module")
def small(finished: Path) -> Findings:
    return find(Results.open(finished, "small"))


@pytest.fixture(scope="module")
def drawn(small: Findings) -> list[Figure]:
    return sections.figures(small)


@pytest.fixture(scope="module")
def report(small: Findings, drawn: list[Figure], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of the finished sweep."""
    return sections.write(small, drawn, tmp_path_factory.mktemp("report") / "report.html")


@pytest.fixture(scope="module")
def page(report: Path) -> Page:
    """What is in it."""
    return Page(report)


def written(findings: Findings, folder: Path) -> Page:
    return Page(sections.write(findings, sections.figures(findings), folder / "report.html"))


def test_every_section_is_there_in_its_order_with_its_data(small: Findings, page: Page) -> None:
    assert page.sections == SECTIONS
    text = " ".join(page.text)
    for shown in (
        "20 done" if len(small.cells) == 20 else f"{len(small.cells)} done",
        "0 failed",
        "0 missing",
        "seeds",
    ):
        assert shown in text
    for name in ("curves", "delta_effect", "gate", "forest", "sensitivity"):
        assert page.found("figure", id=f"chart-{name}")
    assert f"all {len(small.each_cell)} cells are done" in text
    assert [own["href"] for own in page.found("a") if own.get("href") != "#main"] == [
        f"#{name}" for name in SECTIONS[1:]
    ]


def test_the_numbers_of_table_1_are_those_of_the_groups(small: Findings, page: Page) -> None:
    text = re.sub(r"\s+", " ", " ".join(page.text))
    for group in small.best:
        assert group.auc is not None
        assert f"{group.auc.value:.2f} ({group.auc.sd:.2f})".replace("-", "−") in text


def test_the_file_needs_nothing_outside_itself(report: Path, page: Page) -> None:
    for tag, own in page.tags:
        for name in ("src", "href", "action", "srcset"):
            assert (own.get(name) or "#").startswith(("#", "data:")), (tag, own)
    assert "default-src 'none'" in str(page.found("meta", **{"http-equiv": "Content-Security-Policy"}))
    assert "Plotly" in report.read_text()


def test_it_can_be_read_without_eyes_and_mouse(page: Page) -> None:
    assert len(page.found("main")) == len(page.found("header")) == len(page.found("nav")) == len(page.found("h1")) == 1
    assert page.found("html", lang="en")
    heads = page.found("th")
    assert heads
    assert all(head.get("scope") in ("col", "row") for head in heads)
    assert len(page.found("caption")) == len(page.found("table"))
    plots = page.found("div", role="img")
    assert plots
    assert all(len(plot["aria-label"] or "") > 20 for plot in plots)
    assert all(own.get("type") == "button" for own in page.found("button") if own)


def test_the_same_results_give_the_same_bytes(small: Findings, report: Path, tmp_path: Path) -> None:
    again = sections.write(small, sections.figures(small), tmp_path / "again.html")
    assert again.read_bytes() == report.read_bytes()


def test_no_text_of_a_user_becomes_markup(tmp_path: Path) -> None:
    made = synthetic.findings(tmp_path, 2, 2, 5, description=HOSTILE)
    cells = made.cells.copy()
    last = cells.index[cells["agent"] == "ppr"][-1]
    cells.loc[last, ["status", "auc", "error"]] = ["failed", None, HOSTILE]
    folder = tmp_path / 'x"><img src=x onerror=alert(3)>'
    made.results.folder.rename(folder)
    page = written(find(Results(folder), (cells, made.points)), tmp_path)
    assert len(page.found("script")) == 3
    assert not page.found("img")
    assert not [own for _, own in page.tags if any(name.startswith("on") for name in own)]
    assert " ".join(page.text).count(HOSTILE) == 2
    files = json.loads(page.data)["files"]
    table = next(text for name, text in files.items() if name.endswith("unfinished.csv"))
    assert "<script>alert(1)</script>" in table


def test_a_formula_in_a_downloaded_table_is_text(tmp_path: Path) -> None:
    made = synthetic.findings(tmp_path, 1, 2, 5)
    cells = made.cells.copy()
    cells.loc[0, ["status", "auc", "error"]] = ["failed", None, "=HYPERLINK(1)"]
    page = written(find(made.results, (cells, made.points)), tmp_path)
    files = json.loads(page.data)["files"]
    assert ",'=HYPERLINK(1)" in next(text for name, text in files.items() if name.endswith("unfinished.csv"))


def test_cells_that_are_not_done_are_shown_with_their_causes(tmp_path: Path) -> None:
    made = synthetic.findings(tmp_path, 1, 3, 5)
    cells = made.cells.copy()
    for at, status in enumerate(("failed", "missing", "stopped")):
        cells.loc[at, ["status", "error"]] = [status, "the loss is NaN" if status == "failed" else None]
    cells.loc[1, "auc"] = cells.loc[0, "auc"] = None
    page = written(find(made.results, (cells, made.points)), tmp_path)
    text = " ".join(page.text)
    for shown in (
        "1 failed",
        "1 missing",
        "1 stopped",
        "the loss is NaN",
        "not run, or its sweep",
        "stopped early by the",
    ):
        assert shown in text


def test_what_has_no_data_is_left_out_and_named_at_the_end(tmp_path: Path) -> None:
    made = synthetic.findings(tmp_path, 1, 2, 5)
    cells = made.cells.assign(status="missing", auc=None)
    page = written(find(made.results, (cells, made.points.iloc[:0])), tmp_path)
    assert page.sections == ["verdict", "cells", "origin"]
    assert not page.found("figure")
    assert len([own for own in page.found("li") if "data-figure" in own]) >= 7
    assert "No configuration has every seed done yet" in " ".join(page.text)


def test_a_sweep_that_has_not_begun_has_a_report(tmp_path: Path) -> None:
    made = synthetic.findings(tmp_path, 1, 2, 5)
    page = written(find(made.results, (pd.DataFrame(), pd.DataFrame({"cell_id": []}))), tmp_path)
    assert page.sections == ["verdict", "origin"]
    assert "2 seeds; no cell yet." in " ".join(page.text)


@pytest.mark.slow
def test_a_thousand_cells_stay_small_and_show_one_target_at_a_time(tmp_path: Path) -> None:
    made = synthetic.findings(tmp_path, 10, 10, 501)
    assert len(made.cells) == 1000
    drawn = sections.figures(made)
    page = Page(sections.write(made, drawn, tmp_path / "report.html"))
    assert (tmp_path / "report.html").stat().st_size < 15e6
    curves = next(figure for figure in drawn if figure.name == "curves")
    assert isinstance(curves, Chart)
    assert "Of 501 evaluations about every 4th is drawn." in curves.caption
    assert max(len(one.x) for panel in curves.panels for one in panel.series) <= 160
    assert all(panel.series[0].x[0] == 0 and panel.series[0].x[-1] == 5000 for panel in curves.panels)
    assert len(page.found("select")) >= 4
    hidden = [own for own in page.found("div", **{"class": "panel"}) if "hidden" in own]
    assert len(hidden) > len(page.found("div", **{"class": "panel"})) / 2


def test_every_number_of_a_chart_is_one(drawn: list[Figure]) -> None:
    for figure in drawn:
        json.dumps(specs(figure), allow_nan=False)


@pytest.mark.usefixtures("quick_figures")
def test_the_report_is_drawn_with_the_figures(small: Findings, drawn: list[Figure], tmp_path: Path) -> None:
    paths = draw(small, tmp_path, every=True)
    assert paths[0] == tmp_path / "report.html"
    names = {figure.name for figure in drawn if not isinstance(figure, Absent)}
    assert {path.stem for path in paths[1:]} == names
    assert {path.suffix for path in paths[1:]} == {".png", ".svg"}
