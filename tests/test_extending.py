"""The steps of docs/extending.md, carried out on top of the code: what is added is found, swept and reported."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
STEP = re.compile(r"^`([\w/]+\.py)`[^\n]*:\n\n```(python|diff)\n(.*?)^```$", re.MULTILINE | re.DOTALL)

TABULAR = {
    "schema": 1,
    "name": "tabular",
    "seeds": 2,
    "scenarios": [{"source": {"task": "corridor"}, "targets": ["corridor:draught=0.4"]}],
    "hyperparameters": {"episodes": [20]},
    "agents": {"q_learning": {}, "warm_reuse": {}},
}
DEEP = {
    "schema": 1,
    "name": "deep",
    "seeds": 1,
    "scenarios": [{"source": {"task": "cartpole", "agent": "dqn"}, "targets": ["cartpole:gravity=5x"]}],
    "hyperparameters": {"episodes": [6], "evaluation_episodes": [2], "hidden_size": [8], "batch_size": [8]},
    "agents": {"dqn": {}, "bonus_es": {}},
}


BOOT = """
import importlib, json, sys
from pathlib import Path
overlay = Path(sys.argv.pop(1))
for folder in sorted({path.parent for path in overlay.rglob("*.py")}):
    package = importlib.import_module(".".join(folder.relative_to(overlay).parts))
    package.__path__.insert(0, str(folder))
from tests.small_figures import main
for words in json.loads(sys.argv[1]):
    sys.argv = ["deltatune", *words]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
"""
"""Runs commands with the files of a folder in place of those of the same name, and beside the others."""


def steps(folder: Path) -> Path:
    """A folder with every file that the page adds or changes; the others stay where their compiled kernels are."""
    for name, form, text in STEP.findall((ROOT / "docs" / "extending.md").read_text()):
        path, old = folder / name, ROOT / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if form == "python":
            assert not old.exists(), f"{name} is there already"
            path.write_text(text)
        else:
            path.write_text(patched((path if path.exists() else old).read_text(), text))
    return folder


def patched(content: str, diff: str) -> str:
    """Insert the lines marked + after, or where they come first before, the line of the file beside them."""
    lines, waiting, at = content.splitlines(), [], -1
    for line in diff.splitlines():
        sign, text = line[:1], line[1:]
        if sign == "+" and at < 0:
            waiting.append(text)
        elif sign == "+":
            at += 1
            lines.insert(at, text)
        else:
            (found,) = [number for number, each in enumerate(lines) if each == text]
            lines[found:found] = waiting
            at, waiting = found + len(waiting), []
    return "\n".join(lines) + "\n"


def run(overlay: Path, folder: Path, *commands: list[str]) -> str:
    """What commands print with these steps taken."""
    command = [sys.executable, "-c", BOOT, str(overlay), json.dumps(commands)]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "200"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def overlay(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return steps(tmp_path_factory.mktemp("extended"))


def test_the_new_agents_and_the_new_task_are_listed(overlay: Path, tmp_path: Path) -> None:
    listed = run(overlay, tmp_path, ["agents"], ["tasks"])
    assert {"warm_reuse", "bonus_es", "corridor"} <= set(re.findall(r"\w+", listed))


@pytest.mark.parametrize(("space", "agent"), [(TABULAR, "warm_reuse"), (DEEP, "bonus_es")])
def test_a_sweep_with_them_runs_and_is_reported(overlay: Path, tmp_path: Path, space: dict, agent: str) -> None:
    (tmp_path / "space.yaml").write_text(yaml.safe_dump(space))
    name, storage = str(space["name"]), ["--storage", str(tmp_path / "r")]
    sweep = ["sweep", "space.yaml", "--local", "--workers", "1", "--tracking-uri", f"csv:{tmp_path / 'cells.csv'}"]
    shown = run(overlay, tmp_path, [*sweep, *storage], ["export", name, "--format", "markdown", *storage])
    assert agent in shown
    assert f"Copy:     {tmp_path / 'cells.csv'}" in shown
    assert sum(agent in line for line in (tmp_path / "cells.csv").read_text().splitlines()) == space["seeds"]
    assert not re.search(r"[1-9]\d* failed", shown)
    assert agent in (tmp_path / "r" / str(space["name"]) / "report.html").read_text()
    assert "final return <br>[95%]" in (tmp_path / "r" / str(space["name"]) / "report.html").read_text()
    assert "\n  final:\n" in (tmp_path / "r" / str(space["name"]) / "best.yaml").read_text()
    head, _, *lines = (tmp_path / "table.md").read_text().splitlines()
    assert "final return [95%]" in head
    assert any(agent in line for line in lines)
