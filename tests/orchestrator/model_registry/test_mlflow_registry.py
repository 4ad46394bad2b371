"""Registered sources: they play as they were trained, load without this package, and serve a later sweep."""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import mlflow
import numpy as np
import pandas as pd
import pytest
import torch
from conftest import LOCAL
from mlflow.tracking import MlflowClient
from mlflow.utils import requirements_utils
from rich.console import Console

from orchestrator.analysis.findings import find
from orchestrator.execution.session import SweepSession
from orchestrator.execution.sweep import run
from orchestrator.model_registry import mlflow_registry, pretrained
from orchestrator.model_registry.pyfunc_policy import q_values
from orchestrator.model_registry.source_models import logged_name, model_name, source_models, standing
from orchestrator.planning.plan import source_arms, transfer_arms
from orchestrator.planning.source_choice import settle, untrained
from orchestrator.results.sweep_folder import Results
from orchestrator.sources.library import SourceLibrary
from orchestrator.tracking.mlflow.description import markdown
from orchestrator.tracking.sync import sync_now
from orchestrator.tracking.uri import tracking_uri
from search_spaces.loading import parse
from search_spaces.search_space import SearchSpace
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.evaluation import expected_return
from trainables.learners.greedy_evaluation import greedy_returns
from trainables.networks.numba_qnetwork import QNetwork
from trainables.numerics.rng import stream
from trainables.tasks.make import make_env
from trainables.tasks.registry import model_of, parse_task
from trainables.tasks.step_env import Environment

pytestmark = pytest.mark.usefixtures("quick_mlflow")

EPISODES = 10
"""Of one greedy evaluation."""

SOURCE = {"learning_rate": [0.001], "epsilon_decay": [15.0], "target_update": [200], "episodes": [120]}
SPACE: dict[str, Any] = {
    "schema": 1,
    "name": "poles",
    "seeds": 2,
    "scenarios": [
        {
            "source": {"task": "cartpole", "agent": "dqn", "hyperparameters": SOURCE, "pick": "own_seed"},
            "targets": ["cartpole:gravity=5x"],
        }
    ],
    "hyperparameters": {"evaluate_every": [10], "evaluation_episodes": [EPISODES]},
    "agents": {"es": {}},
}
"""Two sources that learn to balance the pole, one to 200 steps and one not quite, and a transfer of each."""

MODEL = "deltatune-cartpole"


def registered(results: Results) -> Results:
    uri = tracking_uri(results.storage, None)
    parent = sync_now(find(results), uri, [])
    mlflow_registry.register_now(results, uri, parent)
    return results


@pytest.fixture(scope="module")
def poles(tmp_path_factory: pytest.TempPathFactory) -> Results:
    results = Results.create(tmp_path_factory.mktemp("poles"), "poles", parse("poles", SPACE))
    tally = run(results, LOCAL, Console(quiet=True))
    assert (tally.ran, tally.failed) == (4, 0)
    return registered(results)


@pytest.fixture(scope="module")
def grid(finished: Path, tmp_path_factory: pytest.TempPathFactory) -> Results:
    storage = tmp_path_factory.mktemp("grid") / "storage"
    shutil.copytree(finished, storage)
    return registered(Results.open(storage, "small"))


@pytest.fixture
def uri(poles: Results) -> Iterator[str]:
    """The store of `poles`, as a researcher's own notebook would name it."""
    where = tracking_uri(poles.storage, None)
    mlflow.set_tracking_uri(where)
    yield where
    mlflow.set_tracking_uri(None)  # type: ignore[arg-type]


def load(name: str) -> Any:
    return mlflow.pyfunc.load_model(name)


def versions(results: Results, name: str) -> dict[str, Any]:
    """Version number to version."""
    client = MlflowClient(tracking_uri(results.storage, None))
    return {str(v.version): v for v in client.search_model_versions(f"name = '{name}'")}


def play(model: Any, cell: Cell, evaluation: int) -> float:
    """The mean return of the cell's evaluation number `evaluation`, its episodes begun from the same seeds."""
    rng, task = stream(cell.seed, "evaluation_env", cell.task), parse_task(cell.task)
    seeds = [[int(rng.integers(2**31)) for _ in range(EPISODES)] for _ in range(evaluation + 1)][evaluation]
    actions = make_env(task).action_space.n  # type: ignore[attr-defined]
    envs = [Environment(make_env(task)) for _ in seeds]
    returns, _ = greedy_returns(envs, seeds, lambda x: np.eye(actions, dtype=np.float32)[model.predict(x)], 1.0)
    return float(returns.mean())


def test_each_version_plays_cartpole_to_the_best_return_of_its_source(poles: Results, uri: str) -> None:
    best = []
    for number, version in versions(poles, MODEL).items():
        record = poles.record(version.tags["cell_id"])
        assert record is not None
        returns = record.returns
        best.append(max(returns))
        last = max(i for i, value in enumerate(returns) if value == max(returns))
        assert play(load(f"models:/{MODEL}/{number}"), record.cell, last) == max(returns)
    assert max(best) == 200.0
    assert 100 < min(best) < 200


def test_a_source_model_is_linked_to_the_aggregates_that_used_it_once(poles: Results, uri: str) -> None:
    mlflow_registry.register_now(poles, uri, sync_now(find(poles), uri, []))
    client = MlflowClient(uri)
    experiment = client.search_experiments(filter_string="name LIKE 'deltatune/%'")[0].experiment_id
    logged = client.search_logged_models([experiment])
    registered = [json.loads(model.tags[mlflow_registry.VERSIONS]) for model in logged]
    assert sorted(int(each["version"]) for (each,) in registered) == list(range(1, len(logged) + 1))
    models = [model.model_id for model in logged]
    used = [
        [each.model_id for each in client.get_run(run.info.run_id).inputs.model_inputs]
        for run in client.search_runs([experiment], "tags.kind = 'aggregate' and tags.stage = 'transfer'")
        if run.data.tags["source"] == "learned"
    ]
    assert models
    assert [sorted(ids) for ids in used] == [sorted(models)]


def test_the_alias_is_on_the_version_with_the_best_greedy_evaluation(poles: Results, uri: str) -> None:
    there = versions(poles, MODEL)
    best = MlflowClient(uri).get_model_version_by_alias(MODEL, "best")
    assert len(there) == 2
    assert float(best.tags["best_return"]) == max(float(v.tags["best_return"]) for v in there.values())


def test_of_deep_versions_with_equal_evaluations_the_auc_decides() -> None:
    deep = [
        {"task": "cartpole", "best_return": b, "auc": a} for b, a in (("9.0", "5.0"), ("9.0", "6.0"), ("8.0", "7.0"))
    ]
    assert max(deep, key=standing) == deep[1]
    tabular = [version | {"task": "windy_gridworld"} for version in deep]
    assert max(tabular, key=standing) == tabular[2]


@pytest.mark.slow
def test_a_process_without_this_package_loads_a_version_and_plays(poles: Results, uri: str, tmp_path: Path) -> None:
    code = f"""
import sys
class Nothing:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("trainables", "orchestrator", "search_spaces", "torch", "numba"):
            raise ImportError(name)
sys.meta_path.insert(0, Nothing())
import json, mlflow, numpy
model = mlflow.pyfunc.load_model("models:/{MODEL}@best")
print(json.dumps(model.predict(numpy.random.default_rng(0).normal(size=(50, 4))).tolist()))
"""
    environment = os.environ | {"MLFLOW_TRACKING_URI": uri, "PYTHONPATH": ""}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "hint" not in done.stderr
    observations = np.random.default_rng(0).normal(size=(50, 4))
    assert json.loads(done.stdout) == load(f"models:/{MODEL}@best").predict(observations).tolist()
    assert not list(tmp_path.iterdir())


def test_a_frame_and_an_array_of_either_width_get_the_same_actions(poles: Results, uri: str) -> None:
    model, wide = load(f"models:/{MODEL}@best"), np.random.default_rng(1).normal(size=(20, 4)).astype(np.float32)
    actions = model.predict(wide)
    assert actions.shape == (20,)
    assert set(actions) == {0, 1}
    for same in (wide.astype(np.float64), pd.DataFrame(wide), pd.DataFrame(wide, columns=list("abcd"))):
        assert (model.predict(same) == actions).all()
    assert model.metadata.signature is not None
    assert model.input_example.shape == (2, 4)
    with pytest.raises(mlflow.exceptions.MlflowException):
        model.predict(wide[:, :3])


def test_nothing_in_a_version_is_pickled_and_little_is_required(poles: Results, uri: str) -> None:
    folder = Path(mlflow.artifacts.download_artifacts(f"models:/{MODEL}@best"))
    files = [path for path in folder.rglob("*") if path.is_file()]
    loaded = [path for path in files if path.parent.name == "__pycache__"]  # Python's own, where the model was loaded
    assert {path.suffix for path in set(files) - set(loaded)} == {".yaml", ".json", ".py", ".npz", ".txt", ""}
    assert (folder / "requirements.txt").read_text().split() == mlflow_registry.REQUIREMENTS


def test_a_tabular_version_has_the_policy_of_its_source(grid: Results, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_URI", tracking_uri(grid.storage, None))
    there = versions(grid, "deltatune-windy_gridworld")
    assert len(there) == 2
    for number, version in there.items():
        record = grid.record(version.tags["cell_id"])
        assert record is not None
        model = load(f"models:/deltatune-windy_gridworld/{number}")
        policy = model.predict(np.arange(400))
        assert expected_return(model_of("windy_gridworld"), policy, 0.99)[0] == record.returns[-1]
        assert (model.predict(pd.DataFrame({"state": range(400)})) == policy).all()
        with pytest.raises(ValueError, match="a state must be 0 to 399"):
            model.predict(np.array([400]))


@pytest.mark.parametrize("sizes", [(4, 64, 64, 2), (8, 256, 256, 4), (3, 2), (6, 17, 5, 9)])
def test_a_loaded_network_has_the_bits_of_the_trained_one(sizes: tuple[int, ...]) -> None:
    generator = torch.Generator().manual_seed(0)
    network = QNetwork(sizes, 64, 1.0, generator=generator)
    network.parameters += np.random.default_rng(0).normal(size=len(network.parameters)).astype(np.float32) / 10
    x = np.random.default_rng(1).normal(size=(300, sizes[0])).astype(np.float32)
    assert (q_values(list(sizes), network.vector(), x) == network.rows(x)).all()


def test_registering_again_changes_nothing(poles: Results, uri: str) -> None:
    def state() -> Any:
        found = versions(poles, MODEL).values()
        model = MlflowClient(uri).get_registered_model(MODEL)
        return sorted((v.version, v.last_updated_timestamp, str(v.tags)) for v in found), model.last_updated_timestamp

    before = state()
    registered(poles)
    assert state() == before


def test_only_sources_that_a_transfer_has_used_are_registered(grid: Results) -> None:
    found = source_models(grid)
    used = {
        cell.sources[0].cell_id
        for cell in grid.plan()["transfer"]
        if cell.sources and cell.sources[0].kind == "learned"
    }
    assert {model.cell.id for model in found} == used
    assert len(found) == 2 < len(grid.plan()["source"])


@pytest.mark.parametrize(
    ("task", "name"),
    [
        ("cartpole", "deltatune-cartpole"),
        ("windy_gridworld:wind=reversed", "deltatune-windy_gridworld-wind-reversed"),
        ("cartpole:gravity=49,pole_length=1", "deltatune-cartpole-gravity-49-pole_length-1"),
    ],
)
def test_a_models_name_can_be_read(task: str, name: str) -> None:
    assert model_name(task) == name


def test_names_of_different_tasks_differ_and_are_safe() -> None:
    tasks = [
        "gym:CartPole-v1",
        "gym:CartPole.v1",
        "a:x=1",
        "a:x=-1",
        "windy_gridworld:start=[1,2]",
        "windy_gridworld:start=[1,3]",
        f"windy_gridworld:wind=[{','.join(['-19'] * 20)}]",
    ]
    names = [model_name(task) for task in tasks]
    assert len(set(names)) == len(tasks)
    assert all(set(name) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.-") for name in names)


def test_mlflow_accepts_the_name_of_every_task() -> None:
    from mlflow.utils.validation import _validate_logged_model_name, _validate_model_name

    from trainables.tasks.registry import all_families

    built_in = [target for family in all_families() for target in (family.name, *family.targets)]
    tasks = ["acrobot:link_mass=1.5", "supply_chain:demand_mean=2.5", "gym:MountainCar-v0:gravity=0.00375"]
    tasks += ["tank.py@0b7a1f88:Task", "tank.py@0b7a1f88:Task:speed=0.5"]
    names = [model_name(task) for task in dict.fromkeys([*built_in, *tasks])]
    assert len(set(names)) == len(names)
    for name in names:
        _validate_model_name(name)
        _validate_logged_model_name(logged_name(name))


def swept(folder: Path, space: SearchSpace, uri: str, *names: str) -> Results:
    """A sweep that is given its sources."""
    found = pretrained.read(names, space, uri)
    results = Results.create(folder, space.name, space)
    pretrained.keep(found, results)
    tally = run(results, replace(LOCAL, pretrained=pretrained.runs(found, space.seeds)), Console(quiet=True))
    assert tally.failed == 0
    return results


def planned(space: SearchSpace, uri: str, *names: str) -> list[Cell]:
    """The transfer cells of a sweep that is given its sources."""
    there = pretrained.runs(pretrained.read(names, space, uri), space.seeds)
    choices = settle(source_arms(space, {}), there, untrained)
    return list(itertools.chain(*(arm.all_cells() for arm in transfer_arms(space, choices, {}))))


def digests(results: Results) -> dict[str, str]:
    return {cell.id: record.digest for stage, cell, record in results.records() if stage == "transfer" and record}


def test_registered_sources_give_the_cells_and_bits_of_trained_ones(poles: Results, uri: str, tmp_path: Path) -> None:
    again = swept(tmp_path, poles.space(), uri, f"models:/{MODEL}/1", f"models:/{MODEL}/2")
    assert again.plan()["source"] == []
    assert digests(again) == digests(poles)
    assert f"--name poles --source models:/{MODEL}/1 --source models:/{MODEL}/2`" in markdown(again, [], [])


def test_one_version_serves_every_seed_with_the_steps_of_its_own_source_run(poles: Results, uri: str) -> None:
    data = json.loads(json.dumps(SPACE))
    del data["scenarios"][0]["source"]["pick"]
    best = MlflowClient(uri).get_model_version_by_alias(MODEL, "best")
    records = [poles.record(cell.id) for cell in poles.plan()["source"]]
    steps = [record.points["step"][-1] for record in records if record]
    cells = planned(parse("poles", data), uri, f"models:/{MODEL}@best")
    assert [(source.cell_id, source.checkpoint, source.steps) for cell in cells for source in cell.sources] == [
        (best.tags["cell_id"], "best", step) for step in steps
    ]


def test_a_file_of_a_library_serves_as_well(grid: Results) -> None:
    uri, (one, _) = tracking_uri(grid.storage, None), source_models(grid)
    (version,) = (n for n, v in versions(grid, "deltatune-windy_gridworld").items() if v.tags["cell_id"] == one.cell.id)
    path = SourceLibrary(grid.storage).path(one.cell.id)
    cells = planned(grid.space(), uri, str(path))
    assert cells == planned(grid.space(), uri, f"models:/deltatune-windy_gridworld/{version}")
    learned = {source.cell_id for cell in cells for source in cell.sources if source.kind == "learned"}
    assert learned == {one.cell.id}


def test_a_source_that_does_not_serve_is_refused(poles: Results, grid: Results, uri: str, tmp_path: Path) -> None:
    space = poles.space()
    own, other = SourceLibrary(poles.storage), SourceLibrary(grid.storage)
    table = other.path(source_models(grid)[0].cell.id)
    torn = tmp_path / "torn.npz"
    torn.write_bytes(table.read_bytes()[:-20])
    wrong = own.path(source_models(poles)[0].cell.id)
    misfit = tmp_path / "misfit.npz"
    misfit.write_bytes(other.load(table.stem).to_bytes({"cell": source_models(poles)[0].cell.to_json()}))
    for names, text in (
        ((f"models:/{MODEL}@worst",), "cannot be had from MLflow"),
        (("models:/nobody/1",), "cannot be had from MLflow"),
        ((f"models:/{MODEL}",), r"is models:/NAME@ALIAS or models:/NAME/VERSION"),
        (("nowhere.npz",), "cannot read the source nowhere.npz"),
        ((str(torn),), "is no source"),
        ((str(table),), "trained on windy_gridworld, but the learned sources of poles are of cartpole"),
        ((str(misfit),), "does not fit cartpole: it lacks the array best"),
        ((str(wrong), str(wrong)), "there are two of seed"),
    ):
        with pytest.raises(InputError, match=text):
            pretrained.read(names, space, uri)


def test_a_version_whose_arrays_were_exchanged_is_refused(poles: Results, uri: str) -> None:
    version = versions(poles, MODEL)["1"]
    other = next(model for model in source_models(poles) if model.cell.id != version.tags["cell_id"])
    fetched = mlflow_registry.fetch(f"models:/{MODEL}/1", uri)
    swapped = mlflow_registry.Fetched(
        fetched.uri, SourceLibrary(poles.storage).path(other.cell.id).read_bytes(), fetched.tags
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mlflow_registry, "fetch", lambda name, where: swapped)
        with pytest.raises(InputError, match="do not agree with its tag 'digest'"):
            pretrained.read([f"models:/{MODEL}/1"], poles.space(), uri)


def test_other_knowledge_of_the_same_cell_is_never_overwritten(poles: Results, uri: str, tmp_path: Path) -> None:
    (found,) = pretrained.read([f"models:/{MODEL}@best"], poles.space(), uri)
    results, other = Results(tmp_path / "poles"), next(g for g in source_models(poles) if g.cell.id != found.cell.id)
    library = SourceLibrary(results.storage)
    library.save(found.cell, other.knowledge)
    with pytest.raises(InputError, match="has different knowledge of the same cell"):
        pretrained.keep([found], results)
    assert library.load(found.cell.id).digest == other.knowledge.digest


def test_a_registry_that_fails_costs_the_sweep_nothing(poles: Results, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> list[str]:
        raise RuntimeError("no registry here")

    monkeypatch.setattr(mlflow_registry, "register", broken)
    uri = tracking_uri(poles.storage, None)
    with SweepSession.open(poles.storage, poles.name, poles.space(), tracking_uri=uri) as session:
        assert session.finish(find(poles), []) == []
    assert session.tracker is not None
    assert str(session.tracker.error) == "no registry here"


def test_a_source_whose_task_has_a_dot_in_its_name_is_registered_and_fetched(
    grid: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = source_models(grid)[0]
    dotted = dataclasses.replace(first, cell=Cell.create("q_learning", "supply_chain:demand_mean=3.5", 0))
    monkeypatch.setattr(mlflow_registry, "source_models", lambda results: [dotted])
    uri = tracking_uri(grid.storage, None)
    parent = sync_now(find(grid), uri, [])
    (said,) = mlflow_registry.register(grid, uri, parent)
    assert said.split()[0] == "models:/deltatune-supply_chain-demand_mean-3.5@best"
    assert mlflow_registry.fetch("models:/deltatune-supply_chain-demand_mean-3.5@best", uri).data


def test_a_version_is_linked_to_the_run_of_the_cell_that_trained_it(poles: Results) -> None:
    client = MlflowClient(tracking_uri(poles.storage, None))
    for version in versions(poles, MODEL).values():
        assert client.get_run(version.run_id).data.tags["cell_id"] == version.tags["cell_id"]


def test_saving_a_version_lists_no_installed_package(
    grid: Results, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed: list[str] = []

    def scan() -> dict[str, list[str]]:
        listed.append("all")
        return {}

    monkeypatch.setattr(requirements_utils, mlflow_registry.SCANNED, None)
    monkeypatch.setattr("importlib_metadata.packages_distributions", scan)
    model = mlflow_registry._save(tmp_path, source_models(grid)[0], "m-1", "run")
    assert (model / "requirements.txt").read_text().split() == mlflow_registry.REQUIREMENTS
    assert not listed
    assert getattr(requirements_utils, mlflow_registry.SCANNED) is None, "for the models that others save"
