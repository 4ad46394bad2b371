"""The report in a real browser: no error, every section drawn, tables sorted by click, nothing over anything else."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dashboards.report import sections
from orchestrator.analysis.findings import find
from tests.dashboards import synthetic

sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this machine"),
]

OVERLAPS = """() => {
  const boxes = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const parent = node.parentElement;
    if (!node.textContent.trim() || parent.closest('script,style,noscript,option,dialog,details,.unseen,.skip'))
      continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    const clip = parent.closest('.scroll,nav ol')?.getBoundingClientRect();
    for (const r of range.getClientRects()) {
      const box = {
        text: node.textContent.trim(), node, left: r.left, right: r.right, top: r.top, bottom: r.bottom,
      };
      if (clip) {
        box.left = Math.max(box.left, clip.left); box.right = Math.min(box.right, clip.right);
        box.top = Math.max(box.top, clip.top); box.bottom = Math.min(box.bottom, clip.bottom);
      }
      if (box.right - box.left > 1 && box.bottom - box.top > 1) boxes.push(box);
    }
  }
  const found = [];
  for (let i = 0; i < boxes.length; i++)
    for (let j = i + 1; j < boxes.length; j++) {
      const [a, b] = [boxes[i], boxes[j]];
      const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const tall = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (a.node !== b.node && wide > 2 && tall > 3) found.push(`${a.text} | ${b.text}`);
    }
  return [boxes.length, found];
}"""


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The report of a sweep of two targets, with a failed, a missing and a stopped cell."""
    folder = tmp_path_factory.mktemp("report")
    made = synthetic.findings(folder, 3, 3, 60, description="A sweep that was never run.")
    cells = made.cells.copy()
    for at, status in zip((-1, -4, -7), ("failed", "missing", "stopped"), strict=True):
        row = cells.index[at]
        cells.loc[row, ["status", "error"]] = [status, "the loss is NaN after 12 steps" if status == "failed" else None]
    changed = find(made.results, (cells, made.points))
    return sections.write(changed, sections.figures(changed), folder / "report.html").as_uri()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


class Visit:
    """One opened page, with everything that it complained of or asked the network for."""

    def __init__(self, browser: Any, width: int, scheme: str = "light") -> None:
        self.complaints: list[str] = []
        self.page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        self.page.on("console", lambda message: self._heard(message.type, message.text))
        self.page.on("pageerror", lambda error: self._heard("error", str(error)))
        self.page.on("request", self._asked)

    def _heard(self, kind: str, text: str) -> None:
        if kind in ("error", "warning"):
            self.complaints.append(text)

    def _asked(self, request: Any) -> None:
        if not request.url.startswith(("file:", "data:", "blob:", "about:")):
            self.complaints.append(request.url)

    def draw_all(self, frame: Any) -> None:
        """Scroll past every plot, so that each is drawn."""
        frame.wait_for_selector("#origin")
        for plot in frame.query_selector_all(".panel:not([hidden]) .plot"):
            plot.scroll_into_view_if_needed()
            frame.wait_for_function("plot => plot.dataset.drawn", arg=plot)
        frame.evaluate("scrollTo(0, 0)")


@pytest.fixture
def visit(browser: Any, request: pytest.FixtureRequest) -> Iterator[Visit]:
    opened = Visit(browser, *getattr(request, "param", (1280,)))
    yield opened
    opened.page.close()


@pytest.mark.parametrize(
    "visit", [(1280,), (400,), pytest.param((1280, "dark"), marks=pytest.mark.slow)], indirect=True
)
def test_everything_is_drawn_without_complaint_and_nothing_lies_over_anything(visit: Visit, address: str) -> None:
    visit.page.goto(address)
    visit.draw_all(visit.page)
    shown = (
        "curves",
        "results",
        "contrasts",
        "matrix",
        "forest",
        "delta",
        "gate",
        "hyperparameters",
        "cells",
        "origin",
    )
    for section in shown:
        assert visit.page.locator(f"#{section} h2").is_visible()
    assert visit.page.locator(".plot svg.main-svg").count() > 10
    assert visit.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    texts, over = visit.page.evaluate(OVERLAPS)
    assert texts > 200
    assert over == []
    assert visit.complaints == []


@pytest.mark.parametrize("visit", [(400,)], indirect=True)
def test_a_narrow_screen_shows_every_number_of_the_main_table(visit: Visit, address: str) -> None:
    visit.page.goto(address)
    visit.page.locator("#table-best").scroll_into_view_if_needed()
    seen = visit.page.evaluate(
        """() => [...document.querySelectorAll('#table-best td.number')]
          .filter((cell) => cell.textContent.trim() !== '\u2013').map((cell) => cell.getBoundingClientRect())
          .map((box) => box.width > 20 && box.left >= 0 && box.right <= innerWidth)"""
    )
    assert len(seen) > 20
    assert all(seen)


def column(page: Any, number: int) -> list[str]:
    return [text.strip() for text in page.locator(f"#table-best tbody td:nth-child({number})").all_inner_texts()]


def test_a_click_and_a_key_sort_a_table(visit: Visit, address: str) -> None:
    visit.page.goto(address)
    head = visit.page.locator("#table-best th", has_text="AUC")
    before = column(visit.page, 6)
    head.get_by_role("button").click()
    up = [float(text.split()[0].replace("−", "-")) for text in column(visit.page, 6)]
    assert head.get_attribute("aria-sort") == "ascending"
    assert up == sorted(up)
    assert column(visit.page, 6) != before
    visit.page.keyboard.press("Enter")
    assert head.get_attribute("aria-sort") == "descending"
    assert [float(text.split()[0].replace("−", "-")) for text in column(visit.page, 6)] == up[::-1]
    visit.page.locator("#table-best th", has_text="transfer ratio").get_by_role("button").click()
    assert column(visit.page, 7)[-3:] == ["–"] * 3


def test_a_table_is_saved_as_csv(visit: Visit, address: str, tmp_path: Path) -> None:
    visit.page.goto(address)
    with visit.page.expect_download() as download:
        visit.page.locator("#table-best").get_by_role("button", name="CSV").click()
    assert download.value.suggested_filename == "synthetic-best.csv"
    download.value.save_as(tmp_path / "best.csv")
    lines = (tmp_path / "best.csv").read_text().splitlines()
    assert lines[0].startswith("task,agent,source,source_task,pick,source_networks,settings")
    assert len(lines) == 1 + len(column(visit.page, 1))


def test_an_agent_is_hidden_and_a_target_is_chosen(visit: Visit, address: str) -> None:
    visit.page.goto(address)
    visit.draw_all(visit.page)
    gate = visit.page.locator("#chart-gate")
    shown = gate.locator(".panel:not([hidden]) h4").first.inner_text()
    gate.locator("select").select_option(gate.locator("option:not([selected])").first.get_attribute("value"))
    assert gate.locator(".panel:not([hidden]) h4").first.inner_text() != shown
    lines = visit.page.locator("#chart-curves .panel").first.locator(".scatterlayer path.js-line")
    before = lines.count()
    visit.page.locator("#chart-curves").get_by_role("button", name="ppr").click()
    assert 0 < lines.count() < before


@pytest.mark.slow
def test_it_works_within_the_sandboxed_frame_of_an_artifact_view(visit: Visit, address: str) -> None:
    text = Path(address.removeprefix("file://")).read_text(encoding="utf-8")
    visit.page.set_content('<iframe sandbox="allow-scripts" width="1200" height="800"></iframe>')
    visit.page.evaluate("text => { document.querySelector('iframe').srcdoc = text }", text)
    frame = visit.page.frames[-1]
    visit.draw_all(frame)
    frame.locator("nav a", has_text="Transfer ratios").click()
    assert frame.locator("#forest h2").is_visible()
    frame.locator("#table-best").get_by_role("button", name="CSV").click()
    assert frame.locator("dialog textarea").input_value().startswith("task,agent,source")
    assert visit.complaints == []


@pytest.mark.slow
def test_dark_and_light_follow_the_system_and_the_button(browser: Any, address: str) -> None:
    visit = Visit(browser, 1280, "dark")
    visit.page.goto(address)
    background = "getComputedStyle(document.body).backgroundColor"
    dark = visit.page.evaluate(background)
    visit.draw_all(visit.page)
    ink = "getComputedStyle(document.querySelector('#chart-curves .ytitle')).fill"
    on_dark = visit.page.evaluate(ink)
    visit.page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert visit.page.evaluate(ink) != on_dark
    visit.page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert visit.page.evaluate(ink) == on_dark
    visit.page.get_by_role("button", name="Theme: dark").click()
    assert visit.page.get_by_role("button", name="Theme: light").is_visible()
    assert visit.page.evaluate(background) == "rgb(255, 255, 255)" != dark
    visit.page.close()
