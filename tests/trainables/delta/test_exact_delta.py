"""Exact values, delta and the theorems: the tables of the specification to the digits printed, and identities."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trainables.delta.bounds import bounds
from trainables.delta.exact import backup, exact_delta, exact_q, policy_q, value_iteration
from trainables.errors import InputError
from trainables.evaluation import expected_return
from trainables.tasks.registry import model_of, parse_task

GAMMA = 0.99
GRIDWORLD = "windy_gridworld"
CHAIN = "supply_chain"

# target: max |delta|, Delta(M_src, M_trg), V*_trg(s0), 200-step return of the optimal and of the source's policy
GRIDWORLD_TABLE = {
    "windy_gridworld": ("0", "0", "-35.921", "-44.53", "-44.53"),
    "windy_gridworld:wind=small": ("0.969", "3.856", "-35.019", "-43.23", "-44.53"),
    "windy_gridworld:wind=additional_1": ("12.233", "22.758", "-33.084", "-40.22", "-200.00"),
    "windy_gridworld:wind=additional_2": ("13.297", "22.851", "-25.800", "-29.85", "-195.88"),
    "windy_gridworld:wind=reversed": ("13.297", "24.345", "-19.459", "-21.63", "-199.93"),
}
CHAIN_TABLE = {
    "supply_chain": ("0", None, "71.638", "144.26", "144.26"),
    "supply_chain:demand_mean=2": ("0.507", None, "55.916", "112.49", "109.51"),
    "supply_chain:demand_mean=5": ("2.511", None, "151.602", "305.63", "218.70"),
}
ROWS = [(GRIDWORLD, target, row) for target, row in GRIDWORLD_TABLE.items()]
ROWS += [(CHAIN, target, row) for target, row in CHAIN_TABLE.items()]


def _as_printed(value: float, printed: str) -> str:
    digits = len(printed.partition(".")[2])
    return f"{abs(value) if digits == 0 else value:.{digits or 9}f}".rstrip("0" if digits == 0 else "").rstrip(".")


def _returns(target: str, source: str) -> list[float]:
    policies = [exact_q(name, GAMMA).argmax(axis=1) for name in (target, source)]
    return [expected_return(model_of(target), policy, GAMMA)[0] for policy in policies]


@pytest.mark.parametrize(("source", "target", "row"), ROWS, ids=[target for _, target, _ in ROWS])
def test_the_table_of_the_specification_to_the_digits_printed(source, target, row) -> None:
    result = bounds(source, target)
    computed = [result.max_abs_delta, result.task_distance, result.v_target, *_returns(target, source)]
    shown = [printed and _as_printed(value, printed) for value, printed in zip(computed, row, strict=True)]
    assert shown == list(row)
    assert result.theorem1_holds
    assert result.theorem3_holds
    assert result.theorem1_bound == pytest.approx(result.max_abs_delta / 0.01)
    assert result.v_source == pytest.approx(exact_q(source, GAMMA)[model_of(source).start].max())


@pytest.mark.parametrize(("source", "target"), [(s, t) for s, t, _ in ROWS], ids=[t for _, t, _ in ROWS])
def test_q_trg_minus_q_src_is_delta_plus_the_expected_difference_ahead(source: str, target: str) -> None:
    model, q_src, q_trg = model_of(target), exact_q(source, GAMMA), exact_q(target, GAMMA)
    live = ~model.terminal
    ahead = np.where(live, q_trg.max(axis=1) - q_src.max(axis=1), 0.0)
    right = exact_delta(model, q_src, GAMMA) + GAMMA * model.expected_next(ahead)
    assert np.abs((q_trg - q_src) - right)[live].max() < 1e-9


@pytest.mark.parametrize("target", list(GRIDWORLD_TABLE))
def test_where_the_reward_is_constant_delta_is_the_papers_definition(target: str) -> None:
    source, model, q_src = model_of(GRIDWORLD), model_of(target), exact_q(GRIDWORLD, GAMMA)
    v_src = q_src.max(axis=1)
    papers = GAMMA * (model.expected_next(v_src) - source.expected_next(v_src))
    assert np.abs(exact_delta(model, q_src, GAMMA) - papers).max() < 1e-9


@pytest.mark.parametrize("task", [GRIDWORLD, "windy_gridworld:wind=reversed", CHAIN])
def test_exact_q_solves_the_bellman_equation_and_its_policy_is_worth_what_it_says(task: str) -> None:
    model, q = model_of(task), exact_q(task, GAMMA)
    assert np.abs(backup(model, q.max(axis=1), GAMMA) - q).max() < 1e-9
    assert np.abs(policy_q(model, q.argmax(axis=1), GAMMA) - q).max() < 1e-9


def test_exact_q_agrees_with_plain_value_iteration_and_cannot_be_overwritten() -> None:
    model, values = model_of(GRIDWORLD), np.zeros(400)
    for _ in range(3000):
        values = backup(model, values, GAMMA).max(axis=1)
    assert np.abs(values - exact_q(GRIDWORLD, GAMMA).max(axis=1)).max() < 1e-9
    with pytest.raises(ValueError, match="read-only"):
        exact_q(GRIDWORLD, GAMMA)[0, 0] = 0.0


def test_delta_is_zero_where_the_episode_has_ended_and_what_the_source_says_of_the_end_does_not_count() -> None:
    model = model_of("windy_gridworld:wind=reversed")
    q_src = exact_q(GRIDWORLD, GAMMA) + 5.0  # a source that is wrong at the goal, too
    delta = exact_delta(model, q_src, GAMMA)
    assert (delta[model.terminal] == 0).all()
    ahead = np.where(model.terminal, 0.0, q_src.max(axis=1))
    expected = model.rewards + GAMMA * model.expected_next(ahead) - q_src
    assert np.abs(delta - expected)[~model.terminal].max() < 1e-9


def _policy_values(task: str, policy: np.ndarray) -> np.ndarray:
    """Q^pi (S, A) by one dense linear solve."""
    model = model_of(task)
    states = np.arange(len(policy))
    p = model.transitions.toarray().reshape(len(policy), -1, len(policy))
    values = np.linalg.solve(
        np.eye(len(policy)) - GAMMA * p[states, policy],
        model.rewards[states, policy],
    )
    return model.rewards + GAMMA * p @ values


def _theorem_3_slack(target: str) -> float:
    """Theorem 3 once more, for the source's optimal policy; from the paper's definition of delta."""
    live = ~model_of(target).terminal
    policy = exact_q(GRIDWORLD, GAMMA).argmax(axis=1)
    q_src, q_trg = _policy_values(GRIDWORLD, policy), _policy_values(target, policy)
    v_src = q_src[np.arange(400), policy]
    delta = GAMMA * (model_of(target).expected_next(v_src) - model_of(GRIDWORLD).expected_next(v_src))
    low, high = (delta + GAMMA / (1 - GAMMA) * extreme for extreme in (delta.min(), delta.max()))
    return float(min((q_trg - q_src - low)[live].min(), (high - q_trg + q_src)[live].min()))


@settings(max_examples=6, deadline=None)
@given(st.tuples(*[st.integers(-3, 3)] * 20))
def test_theorems_1_and_3_hold_in_any_wind(wind: tuple[int, ...]) -> None:
    target = parse_task(f"windy_gridworld:wind=[{','.join(map(str, wind))}]").name
    result = bounds(GRIDWORLD, target)
    assert result.theorem1_holds
    assert result.theorem3_holds
    assert result.task_distance <= result.max_abs_delta / (1 - GAMMA) + 1e-9
    assert result.theorem3_slack == pytest.approx(_theorem_3_slack(target), abs=1e-8)
    assert result.theorem3_slack >= -1e-9


@pytest.mark.parametrize("mean", np.random.default_rng(3).uniform(0.5, 12.0, 2).round(2).tolist())
def test_theorems_1_and_3_hold_under_any_demand(mean: float) -> None:
    result = bounds(CHAIN, f"supply_chain:demand_mean={mean}")
    assert result.theorem1_holds
    assert result.theorem3_holds
    assert 0 < result.task_distance <= result.max_abs_delta / (1 - GAMMA) + 1e-9
    assert result.theorem3_slack >= -1e-9


@pytest.mark.parametrize("gamma", [1.0, -0.1, float("nan"), float("inf")])
def test_bounds_refuse_a_gamma_outside_0_to_1(gamma: float) -> None:
    with pytest.raises(InputError, match=rf"gamma must be .*\(got {gamma}\)"):
        bounds(GRIDWORLD, GRIDWORLD, gamma)


def test_bounds_refuse_tasks_of_different_shape_and_unknown_tasks() -> None:
    with pytest.raises(InputError, match=r"windy_gridworld and supply_chain do not share .*\(400, 4\).*\(2601, 100\)"):
        bounds(GRIDWORLD, CHAIN)
    with pytest.raises(InputError, match="unknown task 'windy'"):
        bounds("windy", GRIDWORLD)


def test_gamma_0_is_allowed_and_looks_one_step_ahead() -> None:
    assert (value_iteration(model_of(GRIDWORLD), 0.0) == model_of(GRIDWORLD).rewards).all()
    assert bounds(GRIDWORLD, "windy_gridworld:wind=reversed", 0.0).max_abs_delta == 0
