"""Bad input of every class: one line on standard error that names it, exit code 2, within seconds, nothing written."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import SPACE

from tests.deltatune.cli.in_process import command

SECONDS = 6.0
"""Of computing: more than any refusal takes, libraries that are imported for it included."""


@pytest.fixture(autouse=True)
def _there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def refused(*words: str) -> str:
    """The line with which a command is refused; it leaves no storage behind."""
    begun = time.process_time()
    code, out, err = command(*words)
    assert (code, out) == (2, ""), err
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert err.strip().isprintable()
    assert time.process_time() - begun < SECONDS
    assert not Path("results").exists()
    return err


HUGE = "1" + 49 * "0"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["sweep", "demo", "--seeds", "100000000"], "seeds must be at most 1,000 (got 100000000)"),
        (["sweep", "demo", "--seeds", HUGE], "seeds must be at most 1,000 (got 1000"),
        (["sweep", "demo", "--seeds", "9" * 5000], "--seeds must be a whole number of fewer digits"),
        (["sweep", "demo", "--seeds", "1e44"], "--seeds must be a whole number, or auto (got '1e44')"),
        (["sweep", "demo", "--workers", HUGE], "--workers must be less than or equal to 10000"),
        (["sweep", "demo", "--workers", "0"], "--workers must be greater than or equal to 1 (got '0')"),
        (["sweep", "demo", "--checkpoint-every", "inf"], "--checkpoint-every must be"),
        (["sweep", "demo", "--checkpoint-every", "1e308"], "--checkpoint-every must be"),
        (["sweep", "demo", "--checkpoint-every", "nan"], "--checkpoint-every must be"),
        (["sweep", "demo", "--time-limit", "inf"], "--time-limit must be less than or equal to 31536000 (got 'inf')"),
        (["sweep", "demo", "--time-limit", "1e308"], "--time-limit must be"),
        (["sweep", "demo", "--time-limit", "nan"], "--time-limit must be"),
        (["sweep", "demo", "--cpus-per-cell", "nan"], "--cpus-per-cell must be"),
        (["sweep", "demo", "--memory-per-cell", "1e300"], "--memory-per-cell must be"),
        (["watch", "x", "--every", "inf"], "--every must be"),
        (["rank", "cartpole", "--episodes", "1000000000"], "--episodes must be less than or equal to 1000000"),
        (["rank", "cartpole", "--seed", "1" + 30 * "0"], "--seed must be"),
        (["sweep", "demo", "--set", f"episodes={HUGE}"], "is not a value"),
        (["sweep", "demo", "--set", "episodes=99999999999"], "episodes must be less than or equal to 1000000000"),
        (["sweep", "demo", "--set", "episodes=" + "[" * 5000], "is not a value"),
        (["bounds", "windy_gridworld", "windy_gridworld", "--gamma", "nan"], "gamma must be"),
    ],
)
def test_a_number_beyond_its_bound(words: list[str], says: str) -> None:
    assert says in refused(*words)


NAMES = ["..", ".", " ", "", "-x", "a\nb", "a\n", "\x1b[31mred", "\U0001f600", "a" * 300, "a/b", "../x", "ä", "a b"]


@pytest.mark.parametrize("name", NAMES, ids=ascii)
@pytest.mark.parametrize("more", [[], ["--dry-run"]], ids=["run", "dry"])
def test_a_name_that_no_sweep_can_have(name: str, more: list[str]) -> None:
    assert "a sweep's name must be letters" in refused("sweep", "demo", f"--name={name}", *more)


@pytest.mark.parametrize("more", [[], ["--dry-run"]], ids=["run", "dry"])
def test_a_name_that_the_storage_folder_has_for_other_files(tmp_path: Path, more: list[str]) -> None:
    for name in ("sources", "Sources", "mlartifacts", "mlflow.db"):
        assert f"a sweep cannot be named '{name}'" in refused("sweep", "demo", f"--name={name}", *more)
    (tmp_path / "space.yaml").write_text(yaml.safe_dump(SPACE | {"name": "sources"}))
    assert "a sweep cannot be named 'sources'" in refused("sweep", "space.yaml", *more)


LONG = "x" * 300


@pytest.mark.parametrize("command_", ["report", "export", "status", "sync", "logs", "watch"])
@pytest.mark.parametrize("name", [LONG, "x/" * 3000, "", "..", "\x1b[31m", "a\nb"], ids=ascii)
def test_a_sweep_that_cannot_be_there(command_: str, name: str) -> None:
    assert "unknown sweep in results" in refused(command_, name)


@pytest.mark.parametrize(
    "words",
    [
        ["sweep", LONG],
        ["sweep", f"{LONG}.yaml"],
        ["sweep", "demo", "--params", LONG],
        ["sweep", "demo", "--storage", "y/" * 3000, "--local"],
        ["check", f"{LONG}.py:Task"],
        ["sources", "add", LONG],
        ["sources", "import", LONG],
        ["init", "cartpole", "-o", LONG],
        ["rank", "cartpole", "--file", LONG],
    ],
    ids=lambda words: " ".join(words)[:24],
)
def test_a_path_that_is_too_long(words: list[str]) -> None:
    refused(*words)


BOMB = "a0: &a0 [1, 1]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12))
FILES = {
    "alias bomb": (BOMB, "holds more than 200,000 values"),
    "alias of itself": ("a: &a [*a]", "'*a' contains itself"),
    "nested lists": ("a: " + "[" * 1000, "nested more than 32 levels deep"),
    "nested mappings": ("a: " + "{b: " * 1000, "nested more than 32 levels deep"),
    "10 MB": ("seeds: [" + "1, " * 3_400_000 + "1]", "more than 4,194,304"),
    "a million seeds": ("seeds: [" + "1," * 1_000_000 + "1]", "holds more than 200,000 values"),
    "50,000 keys": (
        "schema: 1\n" + "".join(f"k{i}: 1\n" for i in range(50_000)),
        "a mapping has 50,001 keys, more than 1,000",
    ),
    "5,000 digits": ("seeds: " + "9" * 5000, "a whole number must be at most 9223372036854775807"),
    "100 digits": ("seeds: -" + "9" * 100, "a whole number must be at most 9223372036854775807"),
    "hexadecimal": ("seeds: 0x" + "f" * 90, "a whole number must be at most 9223372036854775807"),
    "a NUL": ('name: "\\0"', "schema is missing"),
    "nothing": ("", "a search space must be a mapping"),
    "bytes": ("\x00\x01", "not YAML"),
}


@pytest.mark.parametrize("kind", FILES)
@pytest.mark.parametrize("option", ["SPACE", "--params"])
def test_a_file_that_no_person_would_write(kind: str, option: str) -> None:
    text, says = FILES[kind]
    Path("bad.yaml").write_text(text)
    if option == "SPACE":
        assert says in refused("sweep", "bad.yaml", "--dry-run")
    else:
        refused("sweep", "demo", "--params", "bad.yaml", "--dry-run")


@pytest.mark.parametrize("kind", ["pipe", "folder", "device", "missing", "unreadable"])
@pytest.mark.parametrize(
    "words", [["sweep"], ["sweep", "demo", "--dry-run", "--params"], ["sources", "add"], ["sources", "import"]]
)
def test_what_is_no_file_is_not_waited_for(kind: str, words: list[str]) -> None:
    path = Path("odd.yaml")
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "device":
        path.symlink_to("/dev/zero")
    elif kind == "unreadable":
        path.symlink_to(path)
    assert refused(*words, str(path)).startswith("error: cannot read odd.yaml: ")


def changed(**changes: Any) -> str:
    """The file of SPACE with these changes."""
    Path("bad.yaml").write_text(yaml.safe_dump(SPACE | changes))
    return "bad.yaml"


def scenario(**changes: Any) -> list[dict[str, Any]]:
    first = SPACE["scenarios"][0]
    return [{**first, **changes}]


GRID = {name: [0.001 * i for i in range(1, 61)] for name in ("learning_rate", "epsilon", "gamma")}
TARGETS = [f"windy_gridworld:goal=[{i},0]" for i in range(20_000)]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (
            {"hyperparameters": {"learning_rate": GRID["learning_rate"] * 2, "episodes": list(range(1, 101))}},
            "the grid",
        ),
        ({"agents": {"q_learning": {"learning_rate": [0.1] * 10_001}}}, "has 10,001 configurations, more than 10,000"),
        ({"seeds": 1_000, "hyperparameters": {"episodes": list(range(1, 1_000))}}, "cells, more than 1,000,000"),
        ({"seeds": list(range(1_001))}, "seeds must be at most 1,000 (got a list of 1,001)"),
        ({"seeds": 10**12}, "seeds must be at most 1,000"),
        ({"seeds": [2**63 - 1, -1]}, "seeds.1 must be greater than or equal to 0"),
        (
            {"scenarios": scenario(targets=TARGETS)},
            "at most 1,000 entries",
        ),
        ({"scenarios": scenario() * 101}, "scenarios must have at most 100 entries (got 101)"),
        ({"search": {"method": "random", "budget": 10**9}}, "search.budget must be less than or equal to 10000"),
        ({"search": {"method": "random", "budget": 1e9}}, "search.budget must be a whole number"),
        ({"search": {"method": "random", "seed": 2**62, "budget": True}}, "search.budget must be a whole number"),
        ({"hyperparameters": {"episodes": 10**12}}, "episodes must be less than or equal to 1000000000"),
        ({"name": "a" * 65}, "name must be 1 to 64 letters"),
        ({"name": "a\n"}, "name must be 1 to 64 letters"),
    ],
)
def test_a_space_that_is_too_large_is_refused_before_it_is_made(change: dict[str, Any], says: str) -> None:
    assert says in refused("sweep", changed(**change), "--dry-run")


@pytest.mark.parametrize(
    ("storage", "says"),
    [
        ("s3://", "a storage's URL is s3://BUCKET/FOLDER (got 's3://')"),
        ("s3:///", "a storage's URL is s3://BUCKET/FOLDER (got 's3:///')"),
        ("s3:///folder", "a storage's URL is s3://BUCKET/FOLDER"),
        ("gs://", "a storage's URL is gs://BUCKET/FOLDER"),
        ("http://example.org/x", "a storage is a folder, or a URL that starts with file:///, s3://"),
        ("https://", "a storage is a folder, or a URL that starts with"),
        ("ftp://x/y", "a storage is a folder, or a URL that starts with"),
        ("://x", "a storage is a folder, or a URL that starts with"),
        ("file://x", "a storage is a folder, or a URL that starts with"),
        ("zip://x::s3://y", "a storage is a folder, or a URL that starts with"),
        ("gs://bucket/x", "needs a package"),
        (" ", "a storage is a folder, or a URL such as s3://BUCKET/FOLDER (got ' ')"),
    ],
)
@pytest.mark.parametrize("how", ["option", "environment"])
def test_a_storage_that_is_none(storage: str, says: str, how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if how == "environment":
        monkeypatch.setenv("DELTATUNE_STORAGE", storage)
    assert says in refused("list", *(("--storage", storage) if how == "option" else ()))


def test_a_storage_without_credentials_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_PROFILE", "AWS_ENDPOINT_URL"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", "/nowhere")
    monkeypatch.setenv("AWS_CONFIG_FILE", "/nowhere")
    assert "the storage s3://bucket/x does not answer: " in refused("list", "--storage", "s3://bucket/x")


def test_a_storage_that_fails_later_is_one_line_too() -> None:
    from botocore.exceptions import NoCredentialsError

    from orchestrator.errors import exit_code, sentence

    error = NoCredentialsError()
    assert exit_code(error) == 1
    assert sentence(error) == "the storage does not answer: Unable to locate credentials"


@pytest.mark.parametrize("words", [["export", "small", "-o"], ["report", "small", "-o"]])
@pytest.mark.parametrize("place", [LONG, "file/x", "/dev/null/x", "/proc/x"])
def test_a_place_that_cannot_be_written_to(words: list[str], place: str, finished: Path) -> None:
    Path("file").write_text("")
    refused(*words, place, "--storage", str(finished))


@pytest.mark.parametrize("form", ["yaml", "json", "latex"])
def test_a_folder_is_no_file_to_write(form: str, finished: Path) -> None:
    Path("there").mkdir()
    refused("export", "small", "--format", form, "-o", "there", "--storage", str(finished))
    assert list(Path().iterdir()) == [Path("there")]
