"""`import deltatune`: everything that documents use, lazily, and a sweep's results as data frames."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pandas as pd
import pytest
import yaml
from conftest import CELLS, SPACE

import deltatune

ROOT = Path(__file__).parents[2]
PACKAGES = {"trainables", "search_spaces", "orchestrator", "dashboards"}


@pytest.mark.parametrize("name", deltatune.__all__)
def test_every_name_is_there(name: str) -> None:
    assert getattr(deltatune, name) is not None
    assert name in dir(deltatune)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'deltatune' has no attribute 'swep'"):
        _ = deltatune.swep  # type: ignore[attr-defined]
    assert re.match(r"\d+\.\d+", deltatune.__version__)


def _imports(code: str) -> set[str]:
    """The top-level packages that a piece of Python imports."""
    names = set()
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        if isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.split(".")[0])
    return names


def _examples() -> list[tuple[str, str]]:
    inside = "extending.md"  # files of deltatune's own packages
    pages = [ROOT / "README.md", *(page for page in sorted((ROOT / "docs").glob("*.md")) if page.name != inside)]
    blocks = [
        (f"{page.name}:{number}", block)
        for page in pages
        for number, block in enumerate(re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL))
    ]
    files = [(path.name, path.read_text()) for path in sorted((ROOT / "docs" / "examples").glob("*.py"))]
    return [(name, code) for name, code in [*blocks, *files] if "import" in code]


@pytest.mark.parametrize(("name", "code"), _examples(), ids=[name for name, _ in _examples()])
def test_every_example_imports_from_the_face_alone(name: str, code: str) -> None:
    assert not _imports(code) & PACKAGES


def test_results_are_data_frames(finished: Path) -> None:
    results = deltatune.load("small", storage=finished)
    assert len(results.cells) == CELLS
    assert set(results.points["cell_id"]) == set(results.cells["cell_id"])
    assert set(results.table["group"]) >= set(results.best["group"])
    row = results.best.query("agent == 'delta_gate' and source == 'exact' and task.str.endswith('small')").iloc[0]
    assert row["auc_low"] <= row["auc"] <= row["auc_high"]
    assert row["verdict"] in ("helped", "hurt", "undecided")
    first = results.contrasts.iloc[0]
    assert (first["a"], first["b"]) == ("delta_gate", "policy_reuse")
    assert results.contrast("delta_gate", "policy_reuse").iloc[0]["difference"] == first["difference"]
    assert results.over_tasks.empty  # the space names no reference values
    curves = results.curves()
    assert list(curves) == ["task", "agent", "source", "episode", "mean", "low", "high"]
    mine = curves.query(f"task == '{row['task']}' and agent == 'delta_gate' and source == 'exact'")
    assert mine["mean"].mean() == pytest.approx(row["auc"])
    assert "<table" in results._repr_html_()


def test_figures_are_pictures_of_a_notebook(finished: Path) -> None:
    figures = deltatune.load("small", storage=finished).figures()
    assert "curves" in figures
    assert figures["curves"]._repr_png_().startswith(b"\x89PNG")


@pytest.mark.usefixtures("quick_figures")
def test_a_sweep_from_python_gives_its_results_and_goes_on(tmp_path: Path) -> None:
    settings = {
        "storage": tmp_path,
        "seeds": 1,
        "agents": ["q_learning"],
        "local": True,
        "workers": 1,
        "progress": False,
    }
    results = deltatune.sweep(SPACE, mlflow=False, **settings)  # type: ignore[arg-type]
    assert set(results.cells["status"]) == {"done"}
    assert isinstance(results.best, pd.DataFrame)
    assert yaml.safe_load((results.folder / "best.yaml").read_text())["sweep"] == "small"
    grown = deltatune.sweep(SPACE, mlflow=False, **(settings | {"seeds": 2}))  # type: ignore[arg-type]
    assert len(grown.cells) == 2 * len(results.cells)
    assert deltatune.load("small", storage=tmp_path).cells["auc"].notna().all()


def test_bad_input_is_a_sentence_before_any_work(tmp_path: Path) -> None:
    with pytest.raises(deltatune.InputError, match="unknown agent of small 'dqm'"):
        deltatune.sweep(SPACE, storage=tmp_path / "r", agents=["dqm"])
    with pytest.raises(deltatune.InputError, match=r"unknown sweep in .* 'nothing'"):
        deltatune.load("nothing", storage=tmp_path)
    assert not (tmp_path / "r").exists()


def test_the_storage_of_the_environment_is_the_default(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DELTATUNE_STORAGE", str(finished))
    assert deltatune.load("small").folder == finished / "small"
