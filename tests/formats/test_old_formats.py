"""What earlier versions have written is opened, reported and continued by the code of today, for ever."""

from __future__ import annotations

import tarfile
from pathlib import Path
from typing import Any

import pytest

from deltatune.publish import publish
from orchestrator.analysis.findings import find
from orchestrator.execution.session import SweepSession
from orchestrator.execution.settings import Settings
from orchestrator.export.best_params import read_params
from orchestrator.results.status import sweep_status
from orchestrator.results.sweep_folder import Results
from orchestrator.sources.library import SourceLibrary
from orchestrator.tracking.mlflow.store import connect
from orchestrator.tracking.sync import sync
from search_spaces.loading import parse
from tests.formats.make import SPACE
from trainables.storage import checkpoint

LOCAL = Settings(local=True, workers=1)

ARCHIVES = sorted(Path(__file__).parent.glob("*.tar.xz"))

CURVES = {
    "6164a85fe7e3b040": "decdb366ce1b87850a33a68030568209baa87406cbec6923dea809c15bdb1861",
    "6483cebedb9ffe93": "7a9b612005556cb61feac14c652349665dc4081f93c3dcd118d78800f6991aa5",
    "9289c4d99b3bb507": "707de5ce9d4bf3566bd74c609ac1e6e4aa4ef612809eb9ae223eae8426d3d3ed",
    "bf89939e0ad52e61": "c07b7afb0e2eaf54efbe7fc952c0d92989472488f1470753eae53b4347f57b25",
    "cea0a68978771a5a": "9d821f62755321a8fc90f38b02d0c28f23073f14d545d0e411fd2401fe1a6f02",
}
"""Cell to the digest of its curve."""

HALF_DONE = "859b2cdbdfe8917f"
"""The cell that left a checkpoint."""


@pytest.fixture(params=ARCHIVES, ids=lambda path: path.name.removesuffix(".tar.xz"))
def storage(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    with tarfile.open(request.param) as archive:
        archive.extractall(tmp_path, filter="data")
    return tmp_path


def test_there_is_one_of_every_format() -> None:
    assert {path.name for path in ARCHIVES} >= {"before_v0_1.tar.xz", "v0_1.tar.xz"}


def test_a_sweep_is_opened_to_the_last_bit(storage: Path) -> None:
    results = Results.open(storage, "formats")
    assert {cell: head.digest for cell, head in results.heads().items()} == CURVES
    assert all(results.record(cell).digest == digest for cell, digest in CURVES.items())  # type: ignore[union-attr]
    status = sweep_status(results)
    assert status["damage"] == []
    assert {stage: counts["done"] for stage, counts in status["stages"].items()} == {"source": 2, "transfer": 3}
    cells, points = results.tables()
    assert sorted(cells["cell_id"]) == sorted(CURVES)
    assert len(points) == 5 * len(CURVES)


def test_a_source_and_the_best_hyperparameters_are_read(storage: Path) -> None:
    assert [entry.id for entry in SourceLibrary(storage).entries()] == ["9289c4d99b3bb507", "bf89939e0ad52e61"]
    assert len(read_params(storage / "formats" / "best.yaml")) == 4


def test_a_sweep_is_reported(storage: Path) -> None:
    published = publish(Results.open(storage, "formats"))
    assert published.missing == []
    assert published.report is not None
    assert published.best is not None


def test_a_sweep_is_continued_from_its_records_and_its_checkpoint(
    storage: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    resumed, load = [], checkpoint.load_if_whole

    def watched(path: Path) -> Any:
        state = load(path)
        if state is not None:
            resumed.append((path.stem, len(state["points"]["episode"])))
        return state

    monkeypatch.setattr(checkpoint, "load_if_whole", watched)
    grown = parse("formats", SPACE | {"seeds": 2})
    with SweepSession.open(storage, "formats", grown) as now:
        tally = now.run(LOCAL)
    assert (tally.reused, tally.ran, tally.failed) == (5, 5, 0)
    assert resumed == [(HALF_DONE, 3)]
    with SweepSession.open(tmp_path_factory.mktemp("anew"), "formats", grown) as anew:
        anew.run(LOCAL)
        digests = {cell: head.digest for cell, head in anew.results.heads().items()}
    assert {cell: head.digest for cell, head in now.results.heads().items()} == digests
    assert digests.items() >= CURVES.items()


def test_mlflows_store_is_continued(storage: Path) -> None:
    uri = f"sqlite:///{storage / 'mlflow.db'}"

    def runs() -> dict[str, str]:
        client = connect(uri)
        experiments = [each.experiment_id for each in client.search_experiments()]
        found = client.search_runs(experiments, "tags.kind = 'cell'")
        return {run.data.tags["cell_id"]: run.info.run_id for run in found}

    before = runs()
    assert set(before) == set(CURVES)
    sync(find(Results.open(storage, "formats")), uri, [])
    assert runs() == before
