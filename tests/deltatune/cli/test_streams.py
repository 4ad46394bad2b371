"""Output that is closed, full or left by its reader: the work is done, and one sentence says what is missing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from conftest import SPACE

from orchestrator.errors import exit_code, sentence
from orchestrator.results.sweep_folder import Results
from tests.small_figures import DRAWN_SMALL

WORK = """
import sys
from deltatune.cli.streams import Streams
streams = Streams()
print("x" * 100_000)
open(sys.argv[1], "w").write("done")
print(streams.failure(), file=sys.stderr)
"""


def work(tmp_path: Path, redirection: str) -> tuple[int, str]:
    """(exit code, standard error) of a program that prints, works, and asks what has become of its output."""
    script, made = tmp_path / "work.py", tmp_path / "made"
    script.write_text(WORK)
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
    command = f"set -o pipefail; {sys.executable} {script} {made} {redirection}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, env=env, timeout=120)
    assert made.read_text() == "done"
    return done.returncode, done.stderr.strip()


@pytest.mark.parametrize(
    ("redirection", "says"),
    [
        (">/dev/full", "standard output is incomplete (No space left on device)"),
        (">&-", "standard output is incomplete (Bad file descriptor)"),
        ("| true", "None"),
        (">/dev/null", "None"),
    ],
)
def test_output_that_fails_stops_no_work(tmp_path: Path, redirection: str, says: str) -> None:
    code, err = work(tmp_path, redirection)
    assert code == 0
    assert err.startswith(says)
    assert "Traceback" not in err


def test_a_sweep_whose_output_is_full_is_whole_and_says_one_sentence(tmp_path: Path) -> None:
    space = SPACE | {"seeds": 1, "agents": {"q_learning": {}}}
    (tmp_path / "space.yaml").write_text(yaml.safe_dump(space))
    words = ["sweep", str(tmp_path / "space.yaml"), "--storage", str(tmp_path), "--local", "--workers", "1"]
    env = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, *DRAWN_SMALL, *words, "--no-mlflow"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env=env,
            timeout=240,
        )
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("error: standard output is incomplete")
    assert "Traceback" not in done.stderr
    results = Results.open(tmp_path, "small")
    assert all(head is not None for _, _, head in results.planned_heads())
    assert (results.folder / "best.yaml").exists()
    assert (results.folder / "report.html").exists()


def test_a_file_that_the_system_refuses_is_a_sentence() -> None:
    error = OSError(27, "File too large", "results/x/report.html")
    assert exit_code(error) == 1
    assert sentence(error) == "results/x/report.html: File too large"
