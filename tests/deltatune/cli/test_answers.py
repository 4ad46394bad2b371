"""Commands that train nothing answer at once: they load no library that they do not need."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = (
    *("gymnasium", "jinja2", "llvmlite", "matplotlib", "mlflow", "numba", "numpy", "optuna", "pandas", "plotly"),
    *("pyarrow", "ray", "scipy", "torch", "upath"),
)

ASK = f"""
import contextlib, io, json, sys
sys.argv = ["deltatune", *sys.argv[1:]]
with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
    from deltatune.cli.main import main
    try:
        main()
    except SystemExit as end:
        code = end.code or 0
print(json.dumps([code, [name for name in {HEAVY!r} if name in sys.modules], len(sys.modules)]))
"""


def loaded(folder: Path, *words: str) -> tuple[int, list[str], int]:
    """The exit code of a command, the heavy libraries that it has loaded, and how many modules in all."""
    run = subprocess.run([sys.executable, "-c", ASK, *words], cwd=folder, capture_output=True, text=True, check=True)
    code, heavy, modules = json.loads(run.stdout)
    return code, heavy, modules


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a sweep that has a plan, and no cell that has ended."""
    from conftest import SPACE

    from orchestrator.planning.plan import source_arms
    from orchestrator.results.sweep_folder import Results
    from search_spaces.loading import parse

    path, space = tmp_path_factory.mktemp("answers"), parse("small", SPACE)
    results = Results.create(path / "results", "small", space)
    results.set_plan(
        {"source": [c for arms in source_arms(space, {}) for arm in arms.values() for c in arm.all_cells()]}
    )
    return path


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--help"], 0),
        (["--version"], 0),
        (["status"], 0),
        (["status", "small"], 0),
        (["list"], 0),
        (["tasks"], 0),
        (["tasks", "supply_chain"], 0),
        (["agents"], 0),
        (["agents", "delta_es"], 0),
        (["spaces"], 0),
        (["spaces", "demo"], 0),
        (["sweep", "--help"], 0),
        (["sweep", "demo", "--set", "episode=5"], 2),
        (["sweep", "demo", "--agents", "dqm"], 2),
        (["sweep", "dem"], 2),
        (["init", "windy_gridworld"], 0),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_command_that_trains_nothing_loads_nothing_heavy(words: list[str], code: int, folder: Path) -> None:
    found, heavy, modules = loaded(folder, *words)
    assert (found, heavy) == (code, [])
    assert modules < 600


def test_importing_the_package_loads_nothing(tmp_path: Path) -> None:
    ask = f"import sys, deltatune; print([name for name in {(*HEAVY, 'pydantic', 'yaml')!r} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", ask], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_a_driver_that_hands_its_cells_to_ray_compiles_nothing() -> None:
    """It loads no library of the agents before its workers start: they load their own beside it."""
    code = "import sys; import orchestrator.execution.session, orchestrator.execution.executors.ray_executor as r; "
    code += f"print([name for name in {HEAVY!r} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.split("\n")[0] == "['numpy', 'ray']"
