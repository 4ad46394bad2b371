"""Sources, checkpoints and the notes on custom code, damaged in every way: told apart from whole ones, and mended.

The other files of a sweep are in test_mutations.py.
"""

from __future__ import annotations

import itertools
import logging
import shutil
from pathlib import Path

import numpy as np
import pytest

from orchestrator.execution.session import SweepSession
from orchestrator.results import checked_json, plugin_notes
from orchestrator.results.sweep_folder import Results
from orchestrator.sources.library import SourceLibrary
from tests.orchestrator.local_sweeps import LOCAL, space
from tests.orchestrator.results.test_mutations import MUTATIONS, WAYS, look
from trainables.cell import Cell
from trainables.custom import load
from trainables.errors import InputError
from trainables.plugins import notes
from trainables.training.cell_run import run_cell

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"

SHORT = {"episodes": 40, "evaluate_every": 10}

LEARNS = {"q_learning": {}, "delta_gate": {"threshold": [10.0]}}


def swept(storage: Path) -> None:
    with SweepSession.open(storage, "small", space(agents=LEARNS)) as now:
        assert now.run(LOCAL).failed == 0
        now.results.write_tables()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    storage = tmp_path_factory.mktemp("with-sources")
    swept(storage)
    return storage


def sources(storage: Path) -> dict[str, object]:
    """What each source file says: its knowledge, and the record of the cell that trained it."""
    return {
        entry.id: (entry.knowledge.digest, entry.record.digest if entry.record else None)
        for entry in SourceLibrary(storage).entries()
    }


def test_a_damaged_source_is_named_and_the_same_command_trains_it_again(whole: Path, tmp_path: Path) -> None:
    expected, drawn = sources(whole), look(whole)
    rng = np.random.default_rng(9)
    for number in range(MUTATIONS):
        way, storage = WAYS[number % len(WAYS)], tmp_path / str(number)
        shutil.copytree(whole, storage)
        path = sorted((storage / "sources").glob("*.npz"))[number % len(expected)]
        path.write_bytes(way(path.read_bytes(), rng))
        try:
            assert sources(storage) == expected, f"{way.__name__} of a source changed it, and nothing was said"
        except InputError as error:
            text = str(error)
            assert path.name in text
            assert text.endswith("move it away and run the sweep again")
        swept(storage)
        assert sources(storage) == expected, f"{way.__name__} of a source was not mended"
        assert look(storage)[0][4:] == drawn[0][4:]
        shutil.rmtree(storage)


def test_a_cell_whose_checkpoint_is_damaged_starts_again_says_so_and_comes_to_the_same_bits(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    cell, points = Cell.create("q_learning", "windy_gridworld", 1, SHORT), itertools.count(1)
    expected = run_cell(cell, lambda cell: None).digest
    run_cell(cell, lambda cell: None, checkpoints=tmp_path, stop=lambda: next(points) == 3)
    (path,) = tmp_path.iterdir()
    data, rng = path.read_bytes(), np.random.default_rng(10)
    for number in range(MUTATIONS):
        way = WAYS[number % len(WAYS)]
        path.write_bytes(mutated := way(data, rng))
        caplog.clear()
        with caplog.at_level(logging.WARNING):
            outcome = run_cell(cell, lambda cell: None, checkpoints=tmp_path)
        assert (outcome.status, outcome.digest) == ("done", expected)
        assert (path.name in caplog.text) is (mutated != data), f"{way.__name__}: {caplog.text}"


def test_damaged_notes_on_custom_code_are_named_and_the_same_command_writes_them_anew(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    agent = load(f"{EXAMPLES / 'fading_advice.py'}:Agent")
    asked = space(agents={agent: {"episodes": [4], "evaluate_every": [2]}})
    with SweepSession.open(tmp_path, "small", asked) as now:
        assert now.run(LOCAL).failed == 0
    monkeypatch.setattr(notes, "_NOTES", {})
    path, rng = tmp_path / "small" / plugin_notes.FILE, np.random.default_rng(11)
    data = path.read_bytes()
    expected = checked_json.read(path)
    for number in range(MUTATIONS):
        way = WAYS[number % len(WAYS)]
        path.write_bytes(way(data, rng))
        notes._NOTES.clear()
        caplog.clear()
        Results.open(tmp_path, "small")
        known = {name: note for name, note in expected.items() if name != "schema"}
        assert known == notes._NOTES or plugin_notes.FILE in caplog.text, f"{way.__name__}: nothing was said"
        with SweepSession.open(tmp_path, "small", asked) as now:
            assert now.run(LOCAL).ran == 0
        assert checked_json.read(path) == expected, f"{way.__name__} was not mended"
