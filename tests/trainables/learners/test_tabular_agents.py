"""What each tabular agent promises, on cells of a few episodes."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from tests.trainables.small_cells import AGENTS, GAMMA, GATED, REVERSED, digest_of, points_of, return_of, small_cell
from trainables.cell import Cell, Source
from trainables.delta.exact import exact_q
from trainables.knowledge import Knowledge
from trainables.learners import q_learning
from trainables.numerics.rng import stream
from trainables.training.cell_run import run_cell
from trainables.training.source_knowledge import source_knowledge
from trainables.training.train import train

SOURCE = "windy_gridworld"
CHAIN = "supply_chain:demand_mean=5"

GATE = {"max_abs_delta", "pairs_over_threshold", "gate_open", "gate_open_share", "gate_flips"}
STATISTICS = {
    "q_learning": set(),
    "policy_reuse": {"max_abs_delta"},
    "ppr": {"max_abs_delta", "psi", "source_action_share"},
    "delta_gate": GATE,
    "confidence_gate": GATE,
    "q_warm_start": {"max_abs_delta"},
}


@pytest.mark.parametrize("agent", AGENTS)
def test_every_evaluation_has_the_agents_statistics_the_first_included(agent: str) -> None:
    points = points_of(small_cell(agent))
    assert len(points) == 4
    assert [set(point.statistics) for point in points] == [STATISTICS[agent]] * 4
    assert all(np.isfinite(value) for point in points for value in point.statistics.values())
    assert points[0].statistics.get("max_abs_delta", 0.0) == 0.0
    if STATISTICS[agent]:
        assert points[-1].statistics["max_abs_delta"] > 0


@pytest.mark.parametrize("agent", AGENTS)
def test_the_same_cell_gives_the_same_bits_whatever_ran_in_between(agent: str) -> None:
    cell = small_cell(agent)
    before = train(cell)
    first = list(before)
    for other in AGENTS:
        points_of(small_cell(other, seed=1))
    after = train(cell)
    assert digest_of(list(after)) == digest_of(first)
    assert after.knowledge().digest == before.knowledge().digest


def test_the_environment_and_exploration_have_streams_of_their_own_by_seed_and_task(monkeypatch) -> None:
    asked: list[tuple[int, str, str]] = []
    monkeypatch.setattr(q_learning, "stream", lambda *key: (asked.append(key), stream(*key))[1])
    points_of(small_cell("ppr", seed=3))
    assert asked == [(3, "training_env", REVERSED), (3, "exploration", REVERSED)]


def test_two_cells_in_turns_do_not_disturb_each_other() -> None:
    cells = [small_cell("delta_gate", threshold=3.0), small_cell("ppr")]
    in_turns = list(zip(*(train(cell) for cell in cells), strict=True))
    for index, cell in enumerate(cells):
        assert digest_of([points[index] for points in in_turns]) == digest_of(points_of(cell))


@pytest.mark.parametrize("agent", AGENTS)
def test_seed_0_is_a_seed_like_any_other(agent: str) -> None:
    zero, one = (points_of(small_cell(agent, CHAIN, seed=seed)) for seed in (0, 1))
    assert [p.training_return for p in zero[1:]] != [p.training_return for p in one[1:]]


@pytest.mark.parametrize("agent", ["q_learning", "ppr", "delta_gate"])
def test_how_often_one_evaluates_changes_nothing_that_is_learned(agent: str) -> None:
    values = {"threshold": 3.0} if agent == "delta_gate" else {}
    digests = []
    for every in (1, 7, 30):
        training = train(small_cell(agent, evaluate_every=every, **values))
        last = list(training)[-1]
        digests.append((training.knowledge().digest, last.greedy_return, last.step))
    assert digests[0] == digests[1] == digests[2]


# --- gates -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("agent", "values"), [("delta_gate", {"threshold": 3.0}), ("confidence_gate", {"z": 1.0})])
def test_a_gated_agent_is_evaluated_by_the_source_while_open_and_by_q_trg_while_closed(agent, values) -> None:
    training = train(small_cell(agent, episodes=60, evaluate_every=1, **values))
    reused, seen = return_of(REVERSED, exact_q(SOURCE, GAMMA)), set()
    for point in training:
        is_open = point.statistics["gate_open"] == 1.0
        seen.add(is_open)
        q_trg = training.knowledge().arrays["q"]
        assert point.greedy_return == (reused if is_open else return_of(REVERSED, q_trg))
        assert is_open == (point.statistics["pairs_over_threshold"] == 0)
    assert seen == {True, False}


@pytest.mark.parametrize("agent", GATED)
def test_gate_statistics_are_consistent(agent: str) -> None:
    values = {"threshold": 2.0, "delta_learning_rate": 0.5} if agent == "delta_gate" else {"z": 0.5, "min_visits": 2}
    points = points_of(small_cell(agent, episodes=60, evaluate_every=2, **values))
    flips = [p.statistics["gate_flips"] for p in points]
    assert flips == sorted(flips)
    assert flips[-1] > 0
    for point in points:
        # it starts open, so an even number of flips leaves it open
        assert (point.statistics["gate_flips"] % 2 == 0) == (point.statistics["gate_open"] == 1.0)
        assert 0 <= point.statistics["gate_open_share"] <= 1
    assert points[0].statistics["gate_open_share"] == 1.0


def test_a_gate_that_never_closes_is_direct_reuse_and_learns_all_the_same() -> None:
    gate, reuse = train(small_cell("delta_gate", threshold=1e9)), train(small_cell("policy_reuse"))
    assert [p.greedy_return for p in gate] == [p.greedy_return for p in reuse]
    assert gate.knowledge().digest == reuse.knowledge().digest
    assert np.count_nonzero(gate.knowledge().arrays["q"]) > 0


def test_a_gate_that_closes_at_once_and_for_good_is_q_learning_from_then_on() -> None:
    # A source that is off by 1e6 everywhere: delta exceeds the threshold in the first step.
    q_src = np.full((400, 4), 1e6)
    points = points_of(small_cell("delta_gate", evaluate_every=1), Knowledge({"q": q_src}))
    assert [p.statistics["gate_open"] for p in points] == [1.0] + [0.0] * 30
    assert points[1].statistics["gate_open_share"] == 1 / points[1].step
    assert {p.statistics["gate_open_share"] for p in points[2:]} == {0.0}


def test_the_confidence_gate_stays_open_on_the_source_task_and_closes_on_the_reversed_one() -> None:
    same = points_of(small_cell("confidence_gate", SOURCE, episodes=300, evaluate_every=50))
    other = points_of(small_cell("confidence_gate", REVERSED, episodes=300, evaluate_every=50))
    assert [p.statistics["gate_open"] for p in same] == [1.0] * 7
    assert other[-1].statistics["gate_open"] == 0.0


def test_the_exact_source_never_closes_algorithm_1s_gate_at_10_on_reversed() -> None:
    points = points_of(small_cell("delta_gate", REVERSED, episodes=1000, evaluate_every=100))
    assert all(p.statistics["gate_open"] for p in points)
    assert round(points[-1].greedy_return, 2) == -199.93


# --- the other agents ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("task", "source"), [(REVERSED, SOURCE), (CHAIN, "supply_chain")])
def test_direct_reuse_has_a_constant_curve_at_the_exact_return_of_the_source_policy(task: str, source: str) -> None:
    points = points_of(small_cell("policy_reuse", task, episodes=4, evaluate_every=2))
    assert {p.greedy_return for p in points} == {return_of(task, exact_q(source, GAMMA))}


def test_ppr_multiplies_psi_by_nu_after_each_episode() -> None:
    points = points_of(small_cell("ppr", episodes=9, evaluate_every=2, nu=0.7, psi_start=0.9))
    assert [p.episode for p in points] == [0, 2, 4, 6, 8, 9]
    assert [p.statistics["psi"] for p in points] == pytest.approx([0.9 * 0.7**p.episode for p in points], rel=1e-12)


def test_ppr_takes_the_sources_action_with_probability_psi() -> None:
    points = points_of(small_cell("ppr", CHAIN, episodes=12, evaluate_every=1, nu=0.9))
    assert points[0].statistics["source_action_share"] == points[1].statistics["source_action_share"] == 1.0
    for before, after in itertools.pairwise(points):
        psi = before.statistics["psi"]
        assert after.step - before.step == 200
        assert abs(after.statistics["source_action_share"] - psi) <= 5 * np.sqrt(psi * (1 - psi) / 200)


def test_ppr_with_psi_0_never_takes_the_sources_action_and_with_nu_1_always() -> None:
    never = points_of(small_cell("ppr", psi_start=0.0))
    always = points_of(small_cell("ppr", psi_start=1.0, nu=1.0))
    assert {p.statistics["source_action_share"] for p in never} == {0.0}
    assert {p.statistics["source_action_share"] for p in always} == {1.0}


@pytest.mark.parametrize("task", [SOURCE, REVERSED])
def test_a_warm_start_begins_at_the_return_of_the_exact_source(task: str) -> None:
    first = points_of(small_cell("q_warm_start", task))[0]
    assert first.greedy_return == return_of(task, exact_q(SOURCE, GAMMA))


def test_a_warm_start_leaves_its_source_as_it_was() -> None:
    source = Knowledge({"q": exact_q(SOURCE, GAMMA).copy()})
    before = source.digest
    training = train(small_cell("q_warm_start"), source)
    list(training)
    assert source.digest == before != training.knowledge().digest


@pytest.mark.parametrize(("task", "settled"), [(REVERSED, -100.0), (CHAIN, 100.0)])
def test_q_learning_learns(task: str, settled: float) -> None:
    points = points_of(small_cell("q_learning", task, episodes=600, evaluate_every=100))
    assert points[-1].greedy_return > settled > points[0].greedy_return + 50


@pytest.mark.parametrize("every", [7, 300])
def test_epsilon_is_max_of_start_minus_decay_times_episode_and_0(monkeypatch, every: int) -> None:
    epsilons: list[float] = []
    run = q_learning.run_episodes
    monkeypatch.setattr(q_learning, "run_episodes", lambda *a: (epsilons.extend(a[7]), run(*a))[1])
    points_of(small_cell("q_learning", episodes=300, evaluate_every=every))
    assert epsilons == pytest.approx([max(0.1 - 5e-4 * e, 0.0) for e in range(300)], abs=1e-15)
    assert epsilons[0] == 0.1
    assert epsilons[200:] == [0.0] * 100


# --- truncation ------------------------------------------------------------------------------------------------


def _last_updates(truncation: str) -> int:
    """How many entries of Q were set to a bare reward, from a source that says 100 everywhere, alpha 1."""
    cell = small_cell("q_warm_start", CHAIN, episodes=1, evaluate_every=1, learning_rate=1.0, truncation=truncation)
    training = train(cell, Knowledge({"q": np.full((2601, 100), 100.0)}))
    list(training)
    return int(np.count_nonzero(training.knowledge().arrays["q"] < 50))


def test_a_truncated_episodes_last_step_is_learned_from_as_the_option_says() -> None:
    assert _last_updates("terminal") == 1
    assert _last_updates("bootstrap") == 0


def test_the_truncation_option_changes_the_supply_chains_result() -> None:
    curves = [
        digest_of(points_of(small_cell("q_learning", CHAIN, episodes=200, evaluate_every=50, truncation=option)))
        for option in ("terminal", "bootstrap")
    ]
    assert curves[0] != curves[1]


def test_truncation_is_terminal_in_the_supply_chain_and_bootstraps_in_the_gridworld_by_default() -> None:
    assert small_cell("q_learning", CHAIN).hyperparameters["truncation"] == "terminal"
    assert small_cell("q_learning", REVERSED).hyperparameters["truncation"] == "bootstrap"


LIBRARY = [Source(task=f"windy_gridworld:wind={wind}", kind="exact") for wind in ("source", "small", "additional_2")]
WAYS = [
    small_cell("q_learning"),
    small_cell("q_warm_start", truncation="terminal"),
    small_cell("policy_reuse"),
    small_cell("ppr", nu=0.9),
    small_cell("delta_gate", threshold=3.0),
    small_cell("delta_gate", threshold="auto"),
    small_cell("confidence_gate", min_visits=2),
    small_cell("delta_gate", CHAIN),
    Cell.create("delta_select", REVERSED, 0, {"episodes": 30, "evaluate_every": 10}, LIBRARY),
]


@pytest.mark.parametrize("cell", WAYS, ids=lambda cell: f"{cell.agent}-{cell.task}-{cell.id}")
@pytest.mark.parametrize("evaluations", [1, 2, 3])
def test_a_cell_that_goes_on_from_a_checkpoint_has_equal_bits(cell: Cell, evaluations: int, tmp_path: Path) -> None:
    def source(cell: Cell) -> Knowledge | None:
        return source_knowledge(cell, lambda cell_id: pytest.fail(cell_id)) if cell.sources else None

    whole = run_cell(cell, source, keep=True)
    asked = iter([False] * (evaluations - 1) + [True])
    assert run_cell(cell, source, keep=True, checkpoints=tmp_path, stop=lambda: next(asked)) is None
    assert [path.stem for path in tmp_path.iterdir()] == [cell.id]
    trained: list[int] = []
    rest = run_cell(cell, source, keep=True, checkpoints=tmp_path, on_point=lambda point: trained.append(point.episode))
    assert trained == list(range(0, 31, 10))[evaluations:]
    assert whole is not None
    assert rest is not None
    assert (rest.digest, rest.knowledge) == (whole.digest, whole.knowledge)


def test_a_checkpoint_is_not_looked_for_where_none_is_known(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    cell = small_cell("q_learning")
    (tmp_path / f"{cell.id}.checkpoint").mkdir()
    unread = run_cell(cell, lambda cell: None, checkpoints=tmp_path, saved=set())
    assert unread is not None
    assert unread.status == "done"
    assert "starts again" not in caplog.text
    looked = run_cell(cell, lambda cell: None, checkpoints=tmp_path)
    assert looked is not None
    assert looked.digest == unread.digest
    assert "starts again, its checkpoint is unusable: IsADirectoryError" in caplog.text
