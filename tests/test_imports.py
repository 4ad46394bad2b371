"""The arrows between the packages, and who may import what."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ORDER = ["trainables", "search_spaces", "orchestrator", "dashboards"]
FILES = [path for package in ORDER for path in sorted((ROOT / package).rglob("*.py"))]


def imported(path: Path) -> set[str]:
    """The top-level packages that a file imports, anywhere in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        if isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_never_run_up_the_house(path: Path) -> None:
    package = path.relative_to(ROOT).parts[0]
    above = set(ORDER[ORDER.index(package) + 1 :])
    assert not imported(path) & above


@pytest.mark.parametrize(
    ("library", "allowed"),
    [
        ("mlflow", {"tracking.py", "experiment.py", "registry.py", "registered_policy.py"}),
        ("ray", {"trainable.py", "runner.py", "cluster.py", "jobs.py", "search.py", "schedulers.py"}),
        ("matplotlib", {"printed.py"}),
        ("jinja2", {"template.py"}),
    ],
)
def test_only_one_room_knows_each_heavy_library(library: str, allowed: set[str]) -> None:
    assert {path.name for path in FILES if library in imported(path)} == allowed
