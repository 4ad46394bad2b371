"""A dry run writes nothing, never fails, and counts what is done already."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from conftest import SPACE

from orchestrator.execution.forecast import Forecast, forecast
from orchestrator.execution.session import SweepSession
from orchestrator.execution.settings import Settings
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import built_in, load, parse
from tests.orchestrator.local_sweeps import LOCAL, snapshot, space


@pytest.fixture(scope="module")
def storage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A storage with a finished sweep, whose sources others may take over, and none of its tables."""
    folder = tmp_path_factory.mktemp("dry")
    with SweepSession.open(folder, "small", space(agents=SPACE["agents"])) as opened:
        opened.run(LOCAL)
    return folder


def stages(found: Forecast) -> dict[str, tuple[int, int]]:
    return {stage.stage: (stage.cells, stage.done) for stage in found.stages}


def dry(storage: Path, name: str, asked: Any, settings: Settings = LOCAL) -> dict[str, tuple[int, int]]:
    """The forecast's counts; the storage must be byte for byte as before."""
    before = snapshot(storage)
    found = forecast(asked, settings, Results(storage / name), workers=2)
    assert snapshot(storage) == before
    return stages(found)


def test_a_finished_sweep_has_nothing_left(storage: Path) -> None:
    cells, done = dry(storage, "small", space(agents=SPACE["agents"]))["transfer"]
    assert cells == done == 14


def test_a_new_name_counts_the_sources_that_another_sweep_has_trained(storage: Path) -> None:
    assert dry(storage, "new", space(agents=SPACE["agents"])) == {"source": (2, 2), "transfer": (14, 0)}
    assert not (storage / "new").exists()


def test_a_grown_sweep_counts_what_is_new(storage: Path) -> None:
    assert dry(storage, "small", space(agents=SPACE["agents"], seeds=3)) == {"source": (6, 2), "transfer": (42, 14)}


def test_transfers_of_a_source_that_trains_again_stay_done(storage: Path, tmp_path: Path) -> None:
    shutil.copytree(storage, tmp_path / "copy")
    shutil.rmtree(tmp_path / "copy" / "sources")
    more = space(agents=SPACE["agents"] | {"ppr": {}})
    kept, lost = dry(storage, "small", more), dry(tmp_path / "copy", "small", more)
    assert kept == {"source": (2, 2), "transfer": (18, 14)}
    assert lost == {"source": (2, 1), "transfer": (18, 14)}


def test_other_sweeps_that_are_damaged_or_have_no_tables_do_no_harm(storage: Path, tmp_path: Path) -> None:
    shutil.copytree(storage, tmp_path / "copy")
    for path in (tmp_path / "copy" / "small").glob("*.parquet"):
        path.unlink()
    (tmp_path / "copy" / "small" / "plan.json").write_bytes(b"{")
    shutil.copytree(tmp_path / "copy" / "small", tmp_path / "copy" / "other")
    (tmp_path / "copy" / "other" / "sweep.json").write_bytes(b"\0")
    assert dry(tmp_path / "copy", "small", space(agents=SPACE["agents"]))["source"] == (2, 2)
    assert dry(tmp_path / "copy", "new", space(agents=SPACE["agents"]))["source"] == (2, 2)


def test_an_empty_place_is_not_made(tmp_path: Path) -> None:
    assert dry(tmp_path / "nowhere", "new", space())["source"] == (2, 0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", sorted(built_in()))
def test_a_built_in_space_can_be_forecast(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from orchestrator.execution import forecast as module

    def unknown(cell: Any) -> None:
        raise ArithmeticError("not measured here")

    monkeypatch.setattr(module, "measure", unknown)
    assert sum(cells for cells, _ in dry(tmp_path, "new", load(name)).values()) > 0


def test_sources_of_a_library_are_counted(tmp_path: Path) -> None:
    asked = parse(
        "library",
        {
            "schema": 1,
            "name": "library",
            "seeds": 2,
            "scenarios": [
                {
                    "source": {
                        "task": "windy_gridworld",
                        "kinds": ["learned"],
                        "library": ["windy_gridworld:wind=small"],
                    },
                    "targets": ["windy_gridworld:wind=reversed"],
                }
            ],
            "hyperparameters": {"episodes": [20]},
            "agents": {"delta_select": {}},
        },
    )
    assert dry(tmp_path, "library", asked) == {"source": (4, 0), "transfer": (2, 0)}
