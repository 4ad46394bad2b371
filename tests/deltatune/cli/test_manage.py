"""Sweeps as things: listed, compared, renamed and removed, never under a driver."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from deltatune.cli.main import anywhere, app
from orchestrator.results.lock import locked
from orchestrator.results.sweep_folder import Results
from tests.deltatune.cli.in_process import command
from trainables.errors import InputError


def run(*words: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, list(words))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == code, result.output
    return result.stdout


@pytest.fixture
def storage(finished: Path, tmp_path: Path) -> str:
    shutil.copytree(finished / "small", tmp_path / "small")
    return str(tmp_path)


def test_a_list_says_when_how_far_what_came_of_it_and_its_cost(storage: str) -> None:
    (data,) = json.loads(run("list", "--storage", storage, "--json"))
    assert (data["sweep"], data["done"], data["cells"], data["failed"]) == ("small", 32, 32, 0)
    assert data["created"] <= data["changed"]
    assert data["core_seconds"] > 0
    run("export", "small", "--storage", storage, "-o", str(Path(storage) / "small" / "best.yaml"))
    text = run("list", "--storage", storage)
    assert "32 of 32" in text
    effect = json.loads(run("list", "--storage", storage, "--json"))[0]["largest_effect"]
    assert effect is None or (effect["low"] > 0) or (effect["high"] < 0)


@pytest.mark.parametrize("words", ["list", "status", "sources list"])
def test_an_empty_storage_is_a_sentence_and_no_empty_table(words: str, tmp_path: Path) -> None:
    text = run(*words.split(), "--storage", str(tmp_path))
    assert "yet" in text
    assert len(text.splitlines()) == 1
    assert json.loads(run(*words.split(), "--storage", str(tmp_path), "--json")) == []


def test_a_sweep_equals_itself_and_what_only_one_has_is_named(storage: str, finished: Path) -> None:
    shutil.copytree(finished / "small", Path(storage) / "other")
    data = json.loads(run("compare", "small", "other", "--storage", storage, "--json"))
    assert data["rows"]
    assert {row["verdict"] for row in data["rows"]} == {"the same"}
    assert all(row["difference"]["value"] == 0 and row["seeds"] == 2 for row in data["rows"])
    assert (data["only_first"], data["only_second"]) == ([], [])
    assert "difference [95%]" in run("compare", "small", "other", "--storage", storage)


def test_a_renamed_sweep_is_the_same_under_another_name(storage: str) -> None:
    before = Results.open(Path(storage), "small").heads()
    run("mv", "small", "new", "--storage", storage)
    moved = Results.open(Path(storage), "new")
    assert moved.meta()["name"] == "new"
    assert moved.heads().keys() == before.keys()
    with pytest.raises(InputError, match="unknown sweep"):
        Results.open(Path(storage), "small")
    with pytest.raises(InputError, match="there is a sweep or a folder 'new'"):
        run("mv", "new", "new", "--storage", storage)
    with pytest.raises(InputError, match="a sweep's name must be"):
        run("mv", "new", "../x", "--storage", storage)


def test_a_sweep_is_renamed_where_mlflow_fails_without_a_word(storage: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from orchestrator.tracking.mlflow import rename

    def silent(*_: object) -> int:
        raise TimeoutError

    (Path(storage) / "mlflow.db").touch()
    monkeypatch.setattr(rename, "rename_runs", silent)
    assert "MLflow keeps the old name: TimeoutError" in run("mv", "small", "new", "--storage", storage)
    assert (Path(storage) / "new").is_dir()


def test_a_sweep_is_removed_when_that_is_confirmed_and_no_driver_is_at_it(storage: str) -> None:
    with pytest.raises(InputError, match="confirm with --yes"):
        run("rm", "small", "--storage", storage)
    with locked(Path(storage) / "small"), pytest.raises(InputError, match="being run"):
        run("rm", "small", "--yes", "--storage", storage)
    with pytest.raises(InputError, match=r"unknown sweep .* 'smal'"):
        run("rm", "small", "smal", "--yes", "--storage", storage)
    assert (Path(storage) / "small").exists(), "nothing is removed where one name is wrong"
    run("rm", "small", "--yes", "--storage", storage)
    assert not (Path(storage) / "small").exists()


def test_watch_and_logs_speak_json(storage: str) -> None:
    (line,) = run("watch", "small", "--storage", storage, "--json").splitlines()
    assert json.loads(line)["stages"]["transfer"]["done"] == 28
    assert all("line" in json.loads(line) for line in run("logs", "small", "--storage", storage, "--json").splitlines())


@pytest.mark.parametrize("words", [("-q", "list"), ("list", "-q"), ("list", "--quiet")])
def test_quiet_is_taken_before_and_after_a_command(words: tuple[str, ...], storage: str) -> None:
    code, said, complaint = command(*words, "--storage", storage)
    assert (code, complaint) == (0, "")
    assert "small" in said


def test_what_follows_two_dashes_stays_where_it_is() -> None:
    assert anywhere(["status", "-v", "--", "-q"]) == ["-v", "status", "--", "-q"]
