"""Ranking of sources: what is estimated, and that the best is found."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trainables.agents.builtin.dqn import DQN
from trainables.cell import Cell
from trainables.delta.exact import exact_delta, exact_q, policy_q
from trainables.delta.noise_floor import episode_of
from trainables.delta.sample import delta_samples
from trainables.networks.network import source_network
from trainables.source_ranking.deep import DeepComparison
from trainables.source_ranking.path_value import Follower, Seen, merged, nothing_seen
from trainables.source_ranking.ranking import SourceComparison, rank
from trainables.source_ranking.tabular import Player, TabularComparison
from trainables.tasks.registry import model_of
from trainables.tasks.rollout import Transitions
from trainables.training.train import train

GAMMA = 0.99
WINDS = [f"windy_gridworld:wind={name}" for name in ("source", "small", "additional_1", "additional_2", "reversed")]


def _comparison(target: str, sources: list[str], seed: int = 0) -> SourceComparison:
    return TabularComparison(target, [(task, exact_q(task, GAMMA)) for task in sources], GAMMA, seed)


def _everything(task: str) -> Seen:
    """Every transition of a task, each as often as it is probable: what infinitely many episodes would show."""
    model = model_of(task)
    states, actions = model.rewards.shape
    p = model.transitions.tocoo()
    terminal = model.terminal[p.coords[1]]
    state, action = p.coords[0] // actions, p.coords[0] % actions
    reward = model.rewards[state, action] * p.data
    return merged(
        nothing_seen(),
        Seen(state, action, np.where(terminal, states, p.coords[1]), p.data, reward, reward**2 / p.data),
        states,
        actions,
    )


@pytest.mark.parametrize("target", WINDS)
def test_with_all_transitions_known_the_value_is_that_of_following_the_source(target: str) -> None:
    q = exact_q(WINDS[0], GAMMA)
    model, policy = model_of(target), q.argmax(axis=1)
    estimate = Follower(q, model.start, GAMMA).estimate(_everything(target))
    truth = policy_q(model, policy, GAMMA)[model.start, policy[model.start]]
    assert estimate.value == pytest.approx(truth, abs=1e-3)
    assert estimate.promise == q[model.start].max()
    assert estimate.unseen == pytest.approx(0.0, abs=1e-6)


def test_without_any_transition_a_source_is_believed_and_nothing_is_certain() -> None:
    q = exact_q(WINDS[0], GAMMA)
    estimate = Follower(q, 60, GAMMA).estimate(nothing_seen())
    assert (estimate.path_delta, estimate.unseen, estimate.se) == (0.0, 1.0, math.inf)


def test_what_is_not_seen_makes_the_interval_wide() -> None:
    q = exact_q(WINDS[0], GAMMA)
    known = _everything(WINDS[0])
    follower = Follower(q, model_of(WINDS[0]).start, GAMMA)
    near = known.state != 61  # the second cell of row 3, where the path leads
    part = Seen(*(column[near] for column in known))
    assert follower.estimate(part).se > 10 * follower.estimate(known).se


@pytest.mark.parametrize("target", WINDS)
def test_the_exact_knowledge_of_the_target_itself_is_recommended_as_similar(target: str) -> None:
    ranking = rank(_comparison(target, WINDS), 5, 60)
    best = ranking.recommended
    assert best is not None
    # small differs so little from the source that either may come first
    assert target in (WINDS[best.source], *(WINDS[:2] if target in WINDS[:2] else ()))
    assert best.verdict == "similar"
    assert best.floor.path_delta == pytest.approx(0.0, abs=4 * best.floor.se)


def test_none_is_recommended_where_every_source_walks_into_a_wall() -> None:
    ranking = rank(_comparison(WINDS[4], WINDS[:2]), 2, 30)
    assert ranking.recommended is None
    assert all(each.verdict == "no" for each in ranking.ranked)


def test_the_same_seed_ranks_with_the_same_bits_and_every_episode_is_counted() -> None:
    first, again = (rank(_comparison(WINDS[2], WINDS), 5, 30) for _ in range(2))
    assert first == again
    assert sum(each.episodes for each in first.ranked) == 30 - 2  # two at random


def test_delta_along_the_path_is_the_exact_one_where_it_is_known() -> None:
    q = exact_q(WINDS[0], GAMMA)
    player = Player(WINDS[2], 0)
    follower = Follower(q, player.start, GAMMA)
    for _ in range(400):
        player.play(follower.pi, GAMMA)
    follower.value(player.seen)
    exact = exact_delta(model_of(WINDS[2]), q, GAMMA)[np.arange(400), follower.pi]
    often = follower._visits > 400
    assert often.sum() > 20
    assert np.abs(follower._delta - exact)[often].max() < 0.5


# --- deep --------------------------------------------------------------------------------------------------------


class Balancer:
    """A hand-written policy of CartPole with made-up values: push to the side that the pole falls to."""

    def __init__(self, side: float) -> None:
        self._side = side

    def rows(self, observations: np.ndarray) -> np.ndarray:
        """(n, 2)."""
        push = self._side * (observations[:, 2] + 0.5 * observations[:, 3])
        return np.stack([50 - push, 50 + push], axis=1).astype(np.float32)


def test_the_sum_of_delta_along_an_episode_is_its_return_less_the_promise() -> None:
    rng = np.random.default_rng(0)
    observations = rng.normal(size=(21, 4)).astype(np.float32)
    source = Balancer(1.0)
    actions = source.rows(observations[:-1]).argmax(axis=1)
    ends = np.zeros(20, np.bool_)
    ends[-1] = True
    seen = Transitions(observations[:-1], actions, np.ones(20, np.float32), observations[1:], ends)
    episode = episode_of(source, seen, GAMMA)
    assert episode.path_delta + episode.promise == pytest.approx((1 - GAMMA**20) / (1 - GAMMA), abs=1e-3)
    assert episode.mean_abs == pytest.approx(np.abs(delta_samples(source, seen, GAMMA)).mean())


def test_of_two_networks_the_one_that_balances_the_pole_is_found() -> None:
    sources = [("cartpole", Balancer(-1.0)), ("cartpole", Balancer(1.0))]
    ranking = rank(DeepComparison("cartpole:gravity=5x", sources, GAMMA, 0), 2, 8)  # type: ignore[list-item]
    assert [each.source for each in ranking.ranked] == [1, 0]
    assert ranking.ranked[0].target.value > ranking.ranked[1].target.value + 30


def test_states_seen_only_once_leave_the_value_uncertain() -> None:
    """With one sample of each pair nothing tells noise from delta."""
    q, once = np.array([[1.0], [2.0], [3.0]]), np.ones(3)
    rewards, each = np.array([4.0, 1.0, -2.0]), np.arange(3)
    seen = Seen(each, np.zeros(3, np.int64), each + 1, once, rewards, rewards**2)
    assert Follower(q, 0, 0.9).estimate(seen).se > 1.0


def test_a_network_that_played_one_episode_is_not_recommended_for_certain() -> None:
    training = train(Cell.create("dqn", "cartpole", 0, {"episodes": 2, "evaluate_every": 2, "hidden_size": 8}))
    list(training)
    settings = training.cell.settings
    assert isinstance(settings, DQN)
    network = source_network(training.knowledge(), "last", settings, 4, 2)
    comparison = DeepComparison("cartpole", [("cartpole", network)], GAMMA, 0)
    comparison.play(0)
    assert comparison.estimates()[0].se == math.inf
    comparison.play(0)
    assert comparison.estimates()[0].se < math.inf
