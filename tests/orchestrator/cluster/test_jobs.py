"""What goes to a cluster with a job: the files that its command names, and what the code is a copy of."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

import pytest
from conftest import SPACE

from orchestrator.cluster import jobs
from search_spaces.loading import load, parse
from trainables.errors import InputError


class Head:
    """Notes what it is sent."""

    def submit_job(self, entrypoint: str, runtime_env: dict[str, str], metadata: dict[str, str]) -> str:
        folder = Path(runtime_env["working_dir"])
        self.words = shlex.split(entrypoint)
        self.files = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
        return "job"


def sent(words: list[str], space: Any = None) -> Head:
    head = Head()
    assert jobs.submit(head, space or load("demo"), words, "n") == "job"
    return head


@pytest.mark.parametrize("form", ["{option} {file}", "{option}={file}"])
@pytest.mark.parametrize("option", ["--params", "--source", "--file"])
def test_a_file_goes_along_in_either_form_of_an_option(form: str, option: str, tmp_path: Path) -> None:
    (tmp_path / "x.npz").write_bytes(b"x")
    head = sent(form.format(option=option, file=tmp_path / "x.npz").split())
    assert head.files["x.npz"] == b"x"
    assert form.format(option=option, file="x.npz") in shlex.join(head.words)


def test_two_files_of_one_base_name_both_arrive(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "s.npz").write_bytes(folder.encode())
    head = sent(["--source", str(tmp_path / "a" / "s.npz"), f"--source={tmp_path / 'b' / 's.npz'}"])
    first, second = head.words.index("--source") + 1, next(w for w in head.words if w[:9] == "--source=")
    assert head.files[head.words[first]] == b"a"
    assert head.files[second.partition("=")[2]] == b"b"


def test_a_name_that_is_also_a_file_here_stays_a_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "secret").write_bytes(b"x")
    head = sent(["--name", "secret"])
    assert "secret" not in head.files
    assert head.words[head.words.index("--name") + 1] == "secret"


def test_two_custom_files_of_one_name_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = {f"same.py@{letter * 8}": letter.encode() for letter in "abc"}
    monkeypatch.setattr(jobs, "packed", lambda: files)
    names = [f"{key}:Task" for key in files]
    scenario = {"source": {"task": names[0], "hyperparameters": {"learning_rate": [0.5]}}, "targets": [names[0]]}
    assert sent([], parse("small", SPACE | {"scenarios": [scenario]})).files["same.py"] == b"a"
    with pytest.raises(InputError, match=r"two files called same\.py cannot go to a cluster together"):
        sent([], parse("small", SPACE | {"scenarios": [scenario | {"targets": [names[1]]}]}))
