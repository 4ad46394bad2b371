"""A cell of more episodes that continues a shorter one has the bits of one that was trained from scratch."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.golden import golden_cells
from tests.trainables.small_cells import small_cell
from trainables.agents.agent import Agent
from trainables.agents.registry import AGENTS, agent_named
from trainables.cell import Cell
from trainables.custom import agent
from trainables.knowledge import Knowledge
from trainables.learners.step_learner import StepLearner
from trainables.storage import checkpoint
from trainables.training.cell_run import run_cell
from trainables.training.end_states import EndStates, name_of, why_anew
from trainables.training.messages import Outcome
from trainables.training.source_knowledge import source_knowledge
from trainables.training.train import train

LARGE = 10**9
OF_AGENTS = {cell.agent: name for name, cell in reversed(golden_cells.cells().items())}
"""The first golden cell of each agent."""

OF_TASKS = [name for name, cell in golden_cells.cells().items() if cell.agent == "dqn" and "dqn/" in name]


@pytest.fixture(scope="module")
def known() -> dict[str, Knowledge]:
    """The knowledge of the golden cells' sources."""
    found = {}
    for cell in golden_cells.sources().values():
        training = train(cell)
        list(training)
        found[cell.id] = training.knowledge()
    return found


def ran(cell: Cell, ends: EndStates | None, folder: Path, known: dict[str, Knowledge] | None = None) -> Outcome:
    def source(cell: Cell) -> Knowledge | None:
        return source_knowledge(cell, (known or {}).__getitem__) if cell.sources else None

    found = run_cell(cell, source, keep=True, checkpoints=folder / "checkpoints", ends=ends)
    assert found is not None
    assert found.error is None
    return found


def keeping(folder: Path, *shorter: Cell, most_bytes: int = LARGE) -> EndStates:
    """End states in a folder, of which those of some cells may be continued."""
    places: dict[str, list[tuple[int, str]]] = {}
    for cell in shorter:
        places.setdefault(cell.lineage, []).append((cell.settings.episodes, str(folder / "states" / name_of(cell))))
    return EndStates(str(folder / "states"), most_bytes, 0.0, places)


def test_there_is_a_golden_cell_of_every_agent() -> None:
    assert set(OF_AGENTS) >= set(AGENTS)


@pytest.mark.parametrize("name", sorted({*OF_AGENTS.values(), *OF_TASKS, "delta_gate/auto", "confidence_gate/auto"}))
def test_a_continued_cell_has_the_bits_and_the_knowledge_of_one_from_scratch(
    name: str, known: dict[str, Knowledge], tmp_path: Path
) -> None:
    cell = golden_cells.cells()[name]
    every = cell.settings.evaluate_every
    episodes = max(cell.settings.episodes // every, 1) * every
    short, longer = cell.with_episodes(episodes), cell.with_episodes(2 * episodes)
    assert short.lineage == longer.lineage
    ran(short, keeping(tmp_path), tmp_path, known)
    anew = ran(longer, None, tmp_path, known)
    again = ran(longer, keeping(tmp_path, short), tmp_path, known)
    assert (again.digest, again.knowledge) == (anew.digest, anew.knowledge)
    assert again.continued == (0 if why_anew(short) else episodes)
    assert (tmp_path / "states" / name_of(short)).exists() == (not why_anew(short))
    assert bool(why_anew(short)) == ("auto" in name or "fading" in name)


@given(st.integers(1, 4), st.lists(st.integers(1, 4), min_size=1, max_size=3), st.sampled_from(["ppr", "delta_gate"]))
def test_however_often_and_far_a_cell_is_continued(every: int, blocks: list[int], agent: str) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as name:
        folder, cells = Path(name), list[Cell]()
        for count in np.cumsum(blocks):
            cell = small_cell(agent, episodes=int(count) * every, evaluate_every=every)
            found = ran(cell, keeping(folder, *cells), folder)
            assert found.continued == (cells[-1].settings.episodes if cells else 0)
            cells.append(cell)
        assert found.digest == ran(cells[-1], None, folder).digest


def test_a_deep_cell_goes_from_its_longest_shorter_one_though_its_buffer_is_full(tmp_path: Path) -> None:
    values = {"replay_capacity": 100, "batch_size": 8, "hidden_size": 8, "evaluation_episodes": 2, "evaluate_every": 5}
    cells = [Cell.create("dqn", "cartpole", 0, values | {"episodes": count}) for count in (5, 10, 15, 30)]
    for number, cell in enumerate(cells):
        found = ran(cell, keeping(tmp_path, *cells[:number]), tmp_path)
        assert found.continued == (cells[number - 1].settings.episodes if number else 0)
    assert (found.digest, found.knowledge) == (lambda o: (o.digest, o.knowledge))(ran(cells[-1], None, tmp_path))
    assert found.earlier_seconds > 0
    assert found.seconds > found.earlier_seconds


SHORT, LONG = (small_cell("delta_gate", episodes=count) for count in (30, 60))


@pytest.mark.parametrize("harm", ["gone", "torn", "empty", "zeros", "one bit", "of another cell", "another layout"])
def test_an_unusable_end_state_costs_the_saving_and_not_the_cell(
    harm: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    ran(SHORT, keeping(tmp_path), tmp_path)
    path = tmp_path / "states" / name_of(SHORT)
    whole = path.read_bytes()
    if harm == "gone":
        path.unlink()
    elif harm == "of another cell":
        state = checkpoint.load(path)
        state["training"]["cell"] = "0" * 16
        checkpoint.save(path, state)
    elif harm == "another layout":
        state = checkpoint.load(path)
        del state["training"]["learner"]["arrays"]["q"]
        checkpoint.save(path, state)
    else:
        half = len(whole) // 2
        bit = whole[:half] + bytes([whole[half] ^ 4]) + whole[half + 1 :]
        path.write_bytes({"torn": whole[:half], "empty": b"", "zeros": bytes(len(whole)), "one bit": bit}[harm])
    found = ran(LONG, keeping(tmp_path, SHORT), tmp_path)
    assert (found.status, found.continued, found.earlier_seconds) == ("done", 0, 0.0)
    assert found.digest == ran(LONG, None, tmp_path).digest
    assert f"(cell {LONG.id}) starts anew: the end state {path} is missing or unusable" in caplog.text


def test_a_cells_own_checkpoint_comes_before_the_end_state_of_a_shorter_one(tmp_path: Path) -> None:
    ran(SHORT, keeping(tmp_path), tmp_path)
    asked = iter([False, True])
    source = source_knowledge(LONG, {}.__getitem__)
    ends = keeping(tmp_path, SHORT)
    assert run_cell(LONG, lambda cell: source, checkpoints=tmp_path, ends=ends, stop=lambda: next(asked)) is None
    assert checkpoint.load(tmp_path / f"{LONG.id}.checkpoint")["training"]["episodes"] == 50
    (tmp_path / "states" / name_of(SHORT)).unlink()
    found = run_cell(LONG, lambda cell: source, checkpoints=tmp_path, ends=ends)
    assert found is not None
    assert (found.digest, found.continued) == (ran(LONG, None, tmp_path).digest, 0)


@pytest.mark.parametrize(
    "ends",
    [
        lambda folder: keeping(folder, most_bytes=0),
        lambda folder: keeping(folder, most_bytes=1000),
        lambda folder: replace(keeping(folder), least_seconds=60.0),
    ],
    ids=["none is wanted", "too large", "too short to be worth it"],
)
def test_what_is_not_worth_its_place_is_not_kept(ends: Any, tmp_path: Path) -> None:
    assert ran(SHORT, ends(tmp_path), tmp_path).status == "done"
    assert not (tmp_path / "states").exists()


def test_a_disk_that_takes_no_end_state_is_named_and_the_cell_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(path: Path, data: bytes, durable: bool = True) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoint, "write", full)
    assert ran(SHORT, keeping(tmp_path), tmp_path).status == "done"
    assert f"no end state of delta_gate on {SHORT.task}, seed 0 (cell {SHORT.id})" in caplog.text


def test_agents_say_why_a_longer_cell_starts_anew() -> None:
    assert why_anew(SHORT) == ""
    assert why_anew(small_cell("delta_gate", episodes=25)) == "25 episodes are no multiple of evaluate_every, 10"
    auto = small_cell("confidence_gate", threshold="auto")
    assert why_anew(auto) == "threshold: auto is measured over as many episodes as the cell has"


class Counting(StepLearner):
    """A custom learner that can be resumed."""

    def state(self) -> dict[str, Any]:
        counts = {"episode": self._episode, "steps": self._steps, "return": self._return}
        rngs = [self.rng.bit_generator.state, self._env.unwrapped.np_random.bit_generator.state]
        return {"q": self.q.copy(), "rngs": rngs, **counts}

    def restore(self, state: dict[str, Any]) -> None:
        self.q[:] = state["q"]
        self.rng.bit_generator.state, self._env.unwrapped.np_random.bit_generator.state = state["rngs"]
        self._episode, self._steps, self._return = state["episode"], state["steps"], state["return"]


@pytest.mark.parametrize("continues", [True, False])
def test_a_custom_agent_continues_if_it_says_so(
    continues: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: Agent = agent(Counting, AGENTS["q_learning"].hyperparameters, continues=continues)
    monkeypatch.setitem(AGENTS, "counting", replace(made, name="counting", origin="built-in"))
    short, longer = (small_cell("counting", episodes=count, evaluate_every=2) for count in (4, 8))
    ran(short, keeping(tmp_path), tmp_path)
    found = ran(longer, keeping(tmp_path, short), tmp_path)
    assert found.digest == ran(longer, None, tmp_path).digest
    assert found.continued == (4 if continues else 0)
    assert bool(why_anew(short)) != continues
    assert agent_named("dqn").continues


def test_a_compressed_state_is_the_same_and_smaller(tmp_path: Path) -> None:
    state = {"a": np.zeros((1000, 100)), "b": {"c": [1, None, "x"]}}
    checkpoint.save(tmp_path / "plain", state)
    checkpoint.write(tmp_path / "new" / "packed", checkpoint.packed(state), durable=False)
    first, second = checkpoint.load(tmp_path / "plain"), checkpoint.load(tmp_path / "new" / "packed")
    assert (first["a"] == second["a"]).all()
    assert first["b"] == second["b"]
    assert (tmp_path / "new" / "packed").stat().st_size * 100 < (tmp_path / "plain").stat().st_size
