"""Whose commit a result carries: this code's own, wherever it lies."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from orchestrator.cluster import connection
from orchestrator.results import provenance

ASK = """
import json
from orchestrator.results import provenance as p
print(json.dumps([p.commit(), p.versions()["deltatune"]]))
"""


def ask(folder: Path) -> list[str]:
    """Commit and version of the packages in a folder, as a process says that runs there."""
    done = subprocess.run([sys.executable, "-c", ASK], cwd=folder, env={}, capture_output=True, text=True, check=True)
    found: list[str] = json.loads(done.stdout)
    return found


def _git(folder: Path, *words: str) -> None:
    who = ["-c", "user.name=x", "-c", "user.email=x@example.com"]
    subprocess.run(["git", *who, *words], cwd=folder, check=True, capture_output=True)


def test_what_a_surrounding_repository_holds_is_not_the_commit_of_an_installed_package(tmp_path: Path) -> None:
    installed = tmp_path / "venv" / "site-packages"
    installed.mkdir(parents=True)
    (tmp_path / ".gitignore").write_text("venv\n")
    _git(tmp_path, "init", "-q")
    _git(tmp_path, "add", ".gitignore")
    _git(tmp_path, "commit", "-q", "-m", "theirs")
    connection.stage_code(installed)
    (installed / provenance.STAGED_FILE).unlink()
    assert ask(installed)[0] == "unknown"


def test_code_that_was_sent_to_a_cluster_carries_commit_and_version(tmp_path: Path) -> None:
    connection.stage_code(tmp_path)
    assert ask(tmp_path) == [provenance.commit(), provenance.versions()["deltatune"]]


def test_a_checkout_says_its_own_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = connection.stage_code(tmp_path / "code")
    (code / provenance.STAGED_FILE).unlink()
    shutil.rmtree(code / "dashboards")
    _git(code, "init", "-q")
    _git(code, "add", ".")
    _git(code, "commit", "-q", "-m", "ours")
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=code, capture_output=True, text=True, check=True).stdout
    assert ask(code)[0] == head[:12]
    (code / "orchestrator" / "errors.py").write_text("")
    assert ask(code)[0] == f"{head[:12]}+changes"
