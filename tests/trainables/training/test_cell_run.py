"""A cell is done or has failed for a reason of its own: whatever a user's learner hands over, or a checkpoint holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from trainables.cell import Cell, Source
from trainables.curve import EvalPoint
from trainables.errors import InputError, TrainingError
from trainables.knowledge import Knowledge
from trainables.storage import checkpoint
from trainables.training.cell_run import run_cell
from trainables.training.messages import Outcome, lost
from trainables.training.train import Training

POINT = EvalPoint(episode=0, step=0, greedy_return=0.0, discounted_return=0.0, training_return=None, statistics={})


def outcome(**changes: Any) -> Outcome:
    """The outcome of a cell whose learner's points have some of their fields changed."""
    cell = Cell.create("q_learning", "windy_gridworld", 0, {"episodes": 20, "evaluate_every": 10})

    class Learner:
        def __init__(self) -> None:
            self.episode = 0

        def run(self, episodes: int) -> None:
            self.episode += episodes

        def evaluate(self) -> Any:
            return changes["point"] if "point" in changes else replace(POINT, episode=self.episode, **changes)

        def knowledge(self) -> Knowledge:
            return Knowledge({})

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("trainables.training.train.new_learner", lambda cell, source: Learner())
        found = run_cell(cell, lambda cell: None)
    assert found is not None
    return found


def test_numpys_numbers_become_plain_ones() -> None:
    found = outcome(
        step=np.int64(7),
        greedy_return=np.float32(1.5),
        discounted_return=np.array(2.5),
        training_return=np.float64(3.5),
        statistics={"gate": np.float32(0.5), "open": np.True_, "count": 3},
    )
    assert (found.status, found.error) == ("done", None)
    assert found.points["step"] == [7, 7, 7]
    row = {name: values[0] for name, values in found.points.items() if name != "seconds"}
    assert (row["greedy_return"], row["discounted_return"]) == (1.5, 2.5)
    assert {type(value) for value in row.values()} == {int, float}
    assert json.loads(json.dumps(row, allow_nan=False)) == row


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"statistics": {"gate": float("nan")}}, "the statistic 'gate' is nan after episode 0"),
        ({"statistics": {"gate": "open"}}, "the statistic 'gate' must be a number (got 'open' after episode 0)"),
        ({"statistics": [1.0]}, "the statistics must map names to numbers (got [1.0])"),
        ({"greedy_return": np.float32("inf")}, "the greedy return is inf after episode 0"),
        ({"discounted_return": float("nan")}, "the discounted return is nan after episode 0"),
        ({"training_return": float("nan")}, "the training return is nan after episode 0"),
        ({"step": 1.5}, "evaluate() must return a whole number as step (got 1.5)"),
        ({"point": {"episode": 0}}, "evaluate() must return an EvalPoint (got dict)"),
        ({"point": None}, "evaluate() must return an EvalPoint (got NoneType)"),
    ],
)
def test_what_is_no_evaluation_fails_the_cell_with_a_sentence(changes: Mapping[str, Any], says: str) -> None:
    found = outcome(**changes)
    assert found.status == "failed"
    assert str(found.error).startswith(f"TrainingError: {says}")
    assert found.points["episode"] == []


def test_a_point_that_is_plain_already_is_kept_bit_for_bit() -> None:
    point = EvalPoint(10, 20, -3, 0.1 + 0.2, 1e-300, {"gate_open": 1, "delta": 0.1})
    assert EvalPoint.checked(point, 1.0) == point
    assert type(EvalPoint.checked(point, 1.0).greedy_return) is int


CELL = Cell.create("q_learning", "windy_gridworld", 0, {"episodes": 30, "evaluate_every": 10})


def begun(folder: Path) -> Outcome:
    """The outcome of CELL undisturbed; in `folder` is its checkpoint after two evaluations."""
    asked = iter([False, True])
    assert run_cell(CELL, lambda cell: None, checkpoints=folder, stop=lambda: next(asked)) is None
    whole = run_cell(CELL, lambda cell: None)
    assert whole is not None
    return whole


def spoil(folder: Path, how: str) -> None:
    """Give a checkpoint that is whole by its checksum another layout."""
    path = folder / f"{CELL.id}.checkpoint"
    state = checkpoint.load(path)
    if how == "learner":
        del state["training"]["learner"][next(iter(state["training"]["learner"]))]
    elif how == "cell":
        state["training"]["cell"] = "0" * 16
    elif how == "points":
        del state["points"]["step"]
    checkpoint.save(path, state)


@pytest.mark.parametrize("how", ["learner", "cell", "points"])
def test_a_checkpoint_of_another_layout_costs_the_checkpoint_and_not_the_cell(
    tmp_path: Path, how: str, caplog: pytest.LogCaptureFixture
) -> None:
    whole = begun(tmp_path)
    spoil(tmp_path, how)
    found = run_cell(CELL, lambda cell: None, checkpoints=tmp_path)
    assert found is not None
    assert (found.status, found.digest) == ("done", whole.digest)
    assert f"{CELL.id}) starts again, its checkpoint is unusable: " in caplog.text


def test_a_storage_that_times_out_at_resume_starts_the_cell_again_with_a_new_learner(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    whole = begun(tmp_path)
    restore = Training.restore

    def half(training: Training, state: Mapping[str, Any]) -> None:
        restore(training, state)
        raise TimeoutError("the storage does not answer")

    monkeypatch.setattr(Training, "restore", half)
    found = run_cell(CELL, lambda cell: None, checkpoints=tmp_path)
    assert found is not None
    assert (found.status, found.digest) == ("done", whole.digest)
    assert "checkpoint is unusable: TimeoutError: the storage does not answer" in caplog.text


def test_a_state_that_can_never_be_saved_is_said_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(Training, "state", lambda training: {"learner": {"file": object()}})
    found = run_cell(CELL, lambda cell: None, checkpoints=tmp_path, checkpoint_seconds=0)
    assert found is not None
    assert found.status == "done"
    assert caplog.text.count(f"no checkpoint of q_learning on windy_gridworld, seed 0 (cell {CELL.id}): TypeError") == 1


@pytest.mark.parametrize("error", [None, ValueError("in training"), KeyboardInterrupt()])
def test_a_learner_is_closed_however_its_cell_ends(
    monkeypatch: pytest.MonkeyPatch, error: BaseException | None
) -> None:
    closed: list[Training] = []
    monkeypatch.setattr(Training, "close", lambda training: closed.append(training))

    def told(point: EvalPoint) -> None:
        if error is not None:
            raise error

    if error is None:
        run_cell(CELL, lambda cell: None, on_point=told)
    else:
        with pytest.raises(type(error)):
            run_cell(CELL, lambda cell: None, on_point=told)
    assert len(closed) == 1


@pytest.mark.parametrize("agent", ["dqn", "jsrl", "relative_es", "dqinit", "replay_seed"])
def test_deep_learners_close_their_environments(monkeypatch: pytest.MonkeyPatch, agent: str) -> None:
    """Those that play the source before they train too."""
    from trainables.tasks.step_env import Environment

    values = {"episodes": 2, "evaluation_episodes": 2, "hidden_size": 8, "batch_size": 8}
    base = Cell.create("dqn", "cartpole", 0, values)
    trained = run_cell(base, lambda cell: None, keep=True)
    assert trained is not None
    assert trained.knowledge is not None
    knowledge = Knowledge.from_bytes(trained.knowledge)[0]
    source = Source(task="cartpole", kind="learned", cell_id=base.id, checkpoint="last", steps=100)
    made: list[Environment] = []
    closed: list[Environment] = []
    build = Environment.__init__

    def noted(env: Environment, *words: Any, **more: Any) -> None:
        build(env, *words, **more)
        made.append(env)

    monkeypatch.setattr(Environment, "__init__", noted)
    monkeypatch.setattr(Environment, "close", lambda env: closed.append(env))
    cell = Cell.create(agent, "cartpole:gravity=5x", 0, values, None if agent == "dqn" else source)
    found = run_cell(cell, lambda cell: knowledge)
    assert found is not None
    assert found.error is None
    assert len(made) >= 3
    assert set(map(id, closed)) == set(map(id, made))


def test_the_three_kinds_of_errors_are_three() -> None:
    from orchestrator.errors import SweepError, exit_code
    from trainables.errors import InfrastructureError

    kinds = (InputError, TrainingError, InfrastructureError)
    assert not [(a, b) for a in kinds for b in kinds if a is not b and issubclass(a, b)]
    assert issubclass(SweepError, InfrastructureError)
    assert issubclass(checkpoint.CheckpointError, InfrastructureError)
    assert [exit_code(kind("x")) for kind in (InputError, SweepError)] == [2, 1]
    assert lost(CELL, "its worker was lost", 1.0).status == "failed"
