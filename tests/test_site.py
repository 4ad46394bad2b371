"""The documentation site and the notebooks."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))


def code(path: Path) -> str:
    cells = json.loads(path.read_text())["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")


class Page(HTMLParser):
    """The links, the anchors, and what a page loads."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.anchors: set[str] = set()
        self.feed(path.read_text())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.anchors |= {values[name] or "" for name in ("id", "name") if name in values}
        if tag == "a" and values.get("href"):
            self.links.append(str(values["href"]))
        if tag in ("script", "img", "iframe") and values.get("src"):
            self.loads.append(str(values["src"]))
        if tag == "link" and "stylesheet" in (values.get("rel") or ""):
            self.loads.append(str(values["href"]))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_python_that_takes_from_deltatune_alone(path: Path) -> None:
    source = code(path)
    compile(source, path.name, "exec")
    assert "import deltatune" in source
    assert not re.search(r"^\s*(?:from|import) (?:trainables|orchestrator|search_spaces|dashboards)\b", source, re.M)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_links_of_a_notebook_lead_somewhere(path: Path) -> None:
    cells = json.loads(path.read_text())["cells"]
    text = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    for link in re.findall(r"\]\(([^)]+)\)", text):
        name, _, anchor = link.partition("#")
        target = path.parent / name
        assert "://" in link or target.exists(), link
        headings = re.findall(r"^#+ (.*)$", target.read_text(), re.M) if anchor else []
        assert not anchor or anchor in {re.sub(r"[^\w\- ]", "", each).lower().replace(" ", "-") for each in headings}, (
            link
        )


RUNNER = """
import ast, json, sys

cells = json.load(open(sys.argv[1]))["cells"]
names, shown = {"__name__": "__main__"}, []
for cell in cells:
    if cell["cell_type"] != "code":
        continue
    tree = ast.parse("".join(cell["source"]))
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    if last is not None:
        value = eval(compile(ast.Expression(last.value), "cell", "eval"), names)
        for name in ("__repr__", "_repr_png_", "_repr_html_"):
            getattr(value, name, str)()
        shown.append(type(value).__name__)
print("shown:", *shown)
"""
"""Runs a notebook as Jupyter does: the value of a cell's last line is shown."""


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_from_top_to_bottom(path: Path, tmp_path: Path) -> None:
    (tmp_path / "runner.py").write_text(RUNNER)
    env = {name: value for name, value in os.environ.items() if name != "DELTATUNE_STORAGE"}
    env |= {"PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"}
    command = [sys.executable, "runner.py", path]
    done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    assert list((tmp_path / "results").glob("*/cells.parquet"))
    shown = done.stdout.split("shown:")[-1].split()
    assert "DataFrame" in shown
    if path.stem == "demo":
        assert (tmp_path / "results/try/report.html").exists()
        assert {"DataFrame", "Picture"} <= set(shown)
        assert done.stdout.count("\n") > 5


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_every_link_of_it_leads_somewhere(tmp_path: Path) -> None:
    pytest.importorskip("material", reason="the extra [docs] is not installed")
    site = tmp_path / "site"
    env = os.environ | {"PYTHONPATH": str(ROOT), "NO_MKDOCS_2_WARNING": "1"}
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(site)]
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    pages = {path: Page(path) for path in site.rglob("*.html") if path.name != "404.html"}
    assert len(pages) > 20
    for path, page in pages.items():
        assert not [url for url in page.loads if "//" in url], path
        for link in page.links:
            name, _, anchor = link.partition("#")
            if ":" in name or link in ("#", ".", ".."):
                continue
            target = (path.parent / name).resolve() if name else path
            assert target.exists(), (path.name, link)
            assert not anchor or target not in pages or anchor in pages[target].anchors, (path.name, link)
