"""`deltatune sources` and `deltatune rank` on the library of a finished sweep."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from deltatune.cli.main import app
from orchestrator.sources.library import Entry, SourceLibrary
from orchestrator.sources.ranking import rank_sources
from trainables.cell import Cell
from trainables.delta.exact import exact_q
from trainables.errors import InputError
from trainables.knowledge import Knowledge
from trainables.plugins import loader
from trainables.plugins.loader import canonicalise
from trainables.training.train import train

runner = CliRunner()


def _run(*arguments: str, code: int = 0) -> str:
    result = runner.invoke(app, list(arguments))
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    assert result.exit_code == code, result.output
    return result.output


@pytest.fixture
def storage(finished: Path, tmp_path: Path) -> str:
    """A copy of the finished sweep's source library: two learning rates, two seeds."""
    shutil.copytree(finished / "sources", tmp_path / "sources")
    return str(tmp_path)


def test_list_shows_every_source_and_as_json_all_of_it(storage: str) -> None:
    assert _run("sources", "list", "--storage", storage).count("windy_gridworld") == 4
    rows = json.loads(_run("sources", "list", "--storage", storage, "--json"))
    assert {(row["task"], row["agent"], row["seed"], row["learning_rate"]) for row in rows} == {
        ("windy_gridworld", "q_learning", seed, rate) for seed in (0, 1) for rate in (0.5, 0.1)
    }
    assert all(row["bytes"] > 1000 and len(row["digest"]) == 64 for row in rows)


def test_remove_verify_export_import_and_add_go_round(storage: str, tmp_path: Path) -> None:
    ids = SourceLibrary(Path(storage)).ids()
    archive, file = tmp_path / "sources.zip", tmp_path / f"{ids[0]}.npz"
    _run("sources", "export", "-o", str(archive), "--storage", storage)
    shutil.copy(Path(storage) / "sources" / file.name, file)
    _run("sources", "remove", ids[0], ids[1], "--storage", storage)
    assert SourceLibrary(Path(storage)).ids() == ids[2:]
    assert ids[0] in _run("sources", "add", str(file), "--storage", storage)
    _run("sources", "import", str(archive), ids[1], "--storage", storage)
    assert SourceLibrary(Path(storage)).ids() == ids
    assert "4 of 4 sources are intact" in _run("sources", "verify", "--storage", storage)


def test_verify_names_the_damaged_file_in_a_sentence_and_exits_with_1(storage: str) -> None:
    path = next(Path(storage).glob("sources/*.npz"))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    found = json.loads(_run("sources", "verify", "--storage", storage, "--json", code=1))
    assert list(found["broken"]) == [path.stem]
    assert "\n" not in found["broken"][path.stem]
    with pytest.raises(InputError, match=f"{path.name} is damaged"):
        _run("rank", "windy_gridworld", "--storage", storage)


def test_rank_says_which_source_and_why_or_none(storage: str) -> None:
    # After 60 episodes a source knows little: nothing that it does is worth following on the reversed wind.
    found = json.loads(
        _run("rank", "windy_gridworld:wind=reversed", "--episodes", "20", "--storage", storage, "--json", code=3)
    )
    assert found["recommended"] is None
    assert [row["verdict"] for row in found["sources"]] == ["no"] * 4
    lows = [row["low"] for row in found["sources"] if row["low"] is not None]
    assert lows == sorted(lows, reverse=True)
    assert sum(row["episodes"] for row in found["sources"]) == 19
    text = _run("rank", "windy_gridworld:wind=reversed", "--episodes", "20", "--storage", storage, code=3)
    assert "None is similar enough" in text
    assert "by the lower end of the return's interval" in text
    assert _run("rank", "windy_gridworld:wind=reversed", "--episodes", "20", "--storage", storage, code=3) == text


def _entry(wind: str) -> Entry:
    task = f"windy_gridworld:wind={wind}"
    return Entry(Cell.create("q_learning", task, 0), Knowledge({"q": exact_q(task, 0.99)}), None, 0)


@settings(deadline=None, max_examples=6)
@given(st.permutations(["source", "small", "additional_1", "additional_2", "reversed"]), st.integers(0, 3))
def test_the_order_of_the_sources_changes_nothing(order: list[str], seed: int) -> None:
    plain, turned = (
        rank_sources("windy_gridworld:wind=small", [_entry(wind) for wind in winds], 16, seed).to_json()
        for winds in (sorted(order), order)
    )
    assert turned == plain


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["windy_gridwold"], "did you mean 'windy_gridworld'"),
        (["cartpole"], "4 inputs and 2 actions"),
        (["windy_gridworld", "--sources", "cartpole"], "unknown source 'cartpole'"),
    ],
)
def test_what_cannot_be_ranked_is_refused_in_a_sentence(storage: str, arguments: list[str], why: str) -> None:
    with pytest.raises(InputError, match=why) as caught:
        _run("rank", *arguments, "--storage", storage)
    assert "\n" not in str(caught.value)


def test_sources_of_a_custom_task_are_ranked_by_the_name_of_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    example = Path(__file__).parents[3] / "docs" / "examples" / "tank.py"
    (tmp_path / "tank.py").write_text(example.read_text() + "# of this test\n")
    monkeypatch.chdir(tmp_path)
    short = {"episodes": 4, "evaluate_every": 2, "evaluation_episodes": 1, "hidden_size": 8, "batch_size": 4}
    cell = Cell.create("dqn", canonicalise("tank.py:Task"), 0, short)
    training = train(cell)
    assert len(list(training)) == 3
    SourceLibrary(tmp_path / "results").save(cell, training.knowledge())
    monkeypatch.setattr(loader, "_LOADED", {})
    options = ("--sources", "tank.py:Task", "--file", "tank.py", "--episodes", "2", "--json")
    result = runner.invoke(app, ["rank", "tank.py:Task:leak=1.5x", *options])
    assert result.exit_code in (0, 3), result.output
    assert [row["id"] for row in json.loads(result.stdout)["sources"]] == [cell.id]
