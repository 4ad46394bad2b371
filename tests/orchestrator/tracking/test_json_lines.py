"""jsonl:FOLDER has every cell as it ends and every configuration at the end, once each, whatever comes between."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path
from typing import Any

import pytest

from deltatune.publish import publish
from orchestrator.analysis.findings import find
from orchestrator.errors import LeaseLostError
from orchestrator.execution.session import SweepSession
from orchestrator.model_registry import pretrained
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.json_lines import JsonLines
from orchestrator.tracking.sync import sync_now
from orchestrator.tracking.uri import tracking_uri
from tests.orchestrator.local_sweeps import LOCAL, space
from tests.small_figures import small_figures
from trainables.errors import InputError


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """A sweep of q_learning and policy_reuse that was tracked while it ran."""
    storage = tmp_path_factory.mktemp("lines")
    asked = space(seeds=2, agents={"q_learning": {}, "policy_reuse": {}})
    opened = SweepSession.open(storage, "small", asked, tracking_uri=f"jsonl:{storage / 'copy'}")
    with small_figures(), opened as now:
        now.run(LOCAL)
        findings = publish(now.results).findings
        assert now.finish(findings, []) == []
        assert now.tracker is not None
        assert now.tracker.error is None
    return now.results


def file_of(results: Results, folder: Path | None = None) -> Path:
    (path,) = (folder or results.storage / "copy").iterdir()
    return path


def lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_there_is_a_line_per_cell_per_configuration_and_for_the_sweep(done: Results) -> None:
    found, findings = lines(file_of(done)), find(done)
    kinds = [line["kind"] for line in found]
    cells = {line["id"]: line for line in found if line["kind"] == "cell"}
    assert kinds == ["cell"] * len(done.heads()) + ["configuration"] * len(findings.groups) + ["sweep"]
    assert set(cells) == set(done.heads())
    assert found[-1]["status"] == "FINISHED"
    for _, row in findings.cells.iterrows():
        line = cells[row["cell_id"]]
        assert row["group"] in line["configurations"]
        assert line["auc"] == row["auc"]
        assert math.isclose(sum(line["curve"]["greedy_return"]) / len(line["curve"]["greedy_return"]), row["auc"])
    for group, line in zip(findings.groups, found[len(cells) : -1], strict=True):
        assert (line["id"], line["hyperparameters"]) == (group.id, dict(group.hyperparameters))
        assert group.auc is not None
        assert line["auc"] == group.auc.value


def test_synchronising_changes_nothing_and_makes_the_same_file_anew(done: Results, tmp_path: Path) -> None:
    before = file_of(done).read_bytes()
    assert sync_now(find(done), f"jsonl:{done.storage / 'copy'}", []) == str(file_of(done))
    assert file_of(done).read_bytes() == before
    sync_now(find(done), f"jsonl:{tmp_path}", [])
    assert sorted(file_of(done, tmp_path).read_bytes().splitlines()) == sorted(before.splitlines())


def test_a_sweep_that_was_killed_in_a_line_goes_on_with_one_line_of_each(done: Results, tmp_path: Path) -> None:
    shutil.copytree(done.storage / "copy", tmp_path / "copy")
    path = file_of(done, tmp_path / "copy")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 3])
    backend = JsonLines(done, f"jsonl:{tmp_path / 'copy'}")
    backend.end("KILLED")
    assert lines(path)[-1]["status"] == "KILLED"
    sync_now(find(done), f"jsonl:{tmp_path / 'copy'}", [])
    assert sorted(path.read_bytes().splitlines()) == sorted(whole.splitlines())


def test_what_the_sweep_has_no_more_is_gone_and_a_new_curve_replaces_the_old(done: Results, tmp_path: Path) -> None:
    shutil.copytree(done.storage / "copy", tmp_path / "copy")
    path = file_of(done, tmp_path / "copy")
    first, *rest = path.read_text().splitlines(keepends=True)
    old = json.loads(first)
    stale = first.replace(old["digest"], "0" * 16)
    path.write_text(stale + stale.replace(old["id"], "f" * 16) + "".join(rest))
    sync_now(find(done), f"jsonl:{tmp_path / 'copy'}", [])
    assert sorted(path.read_text().splitlines(keepends=True)) == sorted([first, *rest])


@pytest.mark.parametrize("uri", ["jsonl:", "jsonl:s3://bucket/lines", "jsonl:/dev/null/lines"])
def test_what_is_no_folder_on_a_disk_is_refused_before_any_work(uri: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^jsonl: "):
        tracking_uri(tmp_path, uri)


def test_a_folder_is_made_when_the_first_line_is_written(tmp_path: Path) -> None:
    tracking_uri(tmp_path, f"jsonl:{tmp_path / 'new'}")
    assert not (tmp_path / "new").exists()


def test_a_registered_source_comes_from_mlflow_only(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="only MLflow has a registry of trained sources"):
        pretrained.read(["models:/deltatune-cartpole@best"], space(), f"jsonl:{tmp_path}")


def test_who_has_lost_the_writing_to_another_writes_nothing(done: Results, tmp_path: Path) -> None:
    lost: list[Exception] = []

    def check() -> None:
        for error in lost:
            raise error

    (stage, _, first), (_, _, second), *_ = [each for each in done.records() if each[2]]
    assert first is not None
    assert second is not None
    backend = JsonLines(done, f"jsonl:{tmp_path}", check)
    backend.write_cell(stage, first.head, lambda: first)
    before = file_of(done, tmp_path).read_bytes()
    lost.append(LeaseLostError("another writes"))
    for write in (
        lambda: backend.write_cell(stage, second.head, lambda: second),
        lambda: backend.finish(find(done), []),
        lambda: backend.end("KILLED"),
    ):
        with pytest.raises(LeaseLostError):
            write()
    assert lines(file_of(done, tmp_path)) == [json.loads(before)]
