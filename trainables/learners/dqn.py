"""The deep agents: DQN, and Algorithm 2 with each way of using a source beside it, in one step loop.

The numbers in the comments of `_step` and `_learn` are the lines of Algorithm 2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from trainables.agents.hyperparameters import DQN, DeltaPotentialAdvice, DeltaShaping, ExplicitShaping, PotentialAdvice
from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.errors import InputError, TrainingError
from trainables.knowledge import Knowledge
from trainables.learners.advice import Advice
from trainables.learners.greedy_evaluation import greedy_returns
from trainables.learners.replay_buffer import Replay
from trainables.networks.network import Network, new_network, source_network
from trainables.numerics.matmul import F32
from trainables.numerics.rng import seed_sequence, stream
from trainables.tasks.make import make_env
from trainables.tasks.registry import parse_task
from trainables.tasks.step_env import Environment


class DeepLearner:
    """One deep agent at work on one task: its networks, replay buffer, counts and random streams."""

    def __init__(self, cell: Cell, source: Knowledge | None) -> None:
        settings = cell.settings
        assert isinstance(settings, DQN)
        self._settings = settings
        self._task = parse_task(cell.task)
        self._env = Environment(make_env(self._task))
        self._rngs = {
            role: stream(cell.seed, role, cell.task) for role in ("training_env", "evaluation_env", "exploration")
        }
        self._build_networks(cell, source)
        replay_rng = stream(cell.seed, "replay", cell.task)
        self._replay = Replay(settings.replay_capacity, self._env.inputs, settings.batch_size, replay_rng)
        self._evaluation_envs: list[Environment] = []
        self._episode = self._steps = 0
        self._losses, self._updates, self._returns, self._since = 0.0, 0, 0.0, 0  # since the last evaluation
        self._best, self._best_return = self._q.vector(), -math.inf

    def _build_networks(self, cell: Cell, source: Knowledge | None) -> None:
        """Line 2 of Algorithm 2, the target network, and the source's."""
        settings, shape = self._settings, (self._env.inputs, self._env.actions)
        generator = torch.Generator()
        generator.manual_seed(int(seed_sequence(cell.seed, "network_init", cell.task).generate_state(1)[0]))
        self._q = new_network(settings, *shape, settings.learning_rate, generator)
        self._target = new_network(settings, *shape, settings.learning_rate, beside=self._q)
        self._target.load_vector(self._q.vector())
        self._delta: Network | None = None
        if isinstance(settings, DeltaShaping | DeltaPotentialAdvice):
            self._delta = new_network(settings, *shape, settings.delta_learning_rate, generator, beside=self._q)
        self._source = self._advice = None
        if source is not None and cell.sources:
            named = cell.sources[0]
            self._source = source_network(source, named.checkpoint, settings, *shape, self._q)
            steps = int(source.arrays["steps"]) if named.steps is None else named.steps
            self._advice = Advice(self._source, self._delta, decay_constant(settings, steps))
        self._shapes_reward = isinstance(settings, PotentialAdvice)

    @property
    def steps(self) -> int:
        """Training steps so far."""
        return self._steps

    def run(self, episodes: int) -> None:
        """Train for `episodes` more episodes. Raises TrainingError where a number is no longer finite."""
        for _ in range(episodes):
            observation = self._env.reset(_seed(self._rngs["training_env"]))
            done = False
            while not done:
                observation, done = self._step(observation)
            self._episode += 1
        self._since += episodes

    def _step(self, observation: F32) -> tuple[F32, bool]:
        action = self._action(observation)  # 4
        if self._advice is not None:
            self._advice.decay()  # 5
        next_observation, reward, terminated, truncated = self._env.step(action)  # 6
        self._returns += reward
        cut = terminated or (truncated and self._settings.truncation == "terminal")
        self._replay.add(observation, action, reward, next_observation, cut)  # 7
        if self._replay.size >= self._settings.batch_size:
            self._learn()  # 8 to 10
        self._steps += 1  # 11
        if self._steps % self._settings.target_update == 0:
            self._target.load_vector(self._q.vector())
            self._replay.stale = self._replay.size
        return next_observation, terminated or truncated

    def _action(self, observation: F32) -> int:
        """Epsilon-greedy on the values of eq. (5)."""
        rng = self._rngs["exploration"]
        if rng.random() < self._epsilon():
            return int(rng.integers(self._env.actions))
        q = self._q.row(observation)
        if self._advice is None or self._advice.kappa == 0.0:
            return int(q.argmax())
        return self._advice.best(q, observation)

    def _epsilon(self) -> float:
        settings = self._settings
        n = self._episode if settings.epsilon_unit == "episodes" else self._steps
        span = settings.epsilon_start - settings.epsilon_end
        return settings.epsilon_end + span * math.exp(-n / settings.epsilon_decay)

    def _learn(self) -> None:
        replay = self._replay
        if replay.sample():  # 9; one minibatch serves both networks
            self._refresh()
            replay.gather()
        delta_loss = 0.0
        if self._delta is not None:  # 8, eq. (4)
            delta_loss = self._delta.update(replay.x, replay.chosen, replay.delta_targets)
        loss = self._q.update(replay.x, replay.chosen, replay.targets)  # 10
        if not math.isfinite(loss + delta_loss):
            raise TrainingError(self._cause(loss + delta_loss))
        self._losses += loss
        self._updates += 1

    def _refresh(self) -> None:
        """Compute what the targets of the stale transitions are made of."""
        replay, gamma = self._replay, np.float32(self._settings.gamma)
        for part in replay.newest(replay.stale):
            values = self._target.rows(replay.next_observations[part])
            if self._shapes_reward and self._advice is not None:  # r + gamma Phi(s',a') - Phi(s,a)
                values += self._advice.rows(replay.next_observations[part])
                replay.advice[part] = _chosen(self._advice.rows(replay.observations[part]), replay.actions[part])
            replay.future[part] = np.where(replay.terminated[part], np.float32(0), gamma * values.max(axis=1))
        replay.stale = 0
        if self._delta is None or self._source is None:
            return
        for part in replay.newest(replay.stale_delta):  # r + gamma max_b Q_src(s',b) - Q_src(s,a)
            v_src = self._source.rows(replay.next_observations[part]).max(axis=1)
            q_src = _chosen(self._source.rows(replay.observations[part]), replay.actions[part])
            future = np.where(replay.terminated[part], np.float32(0), gamma * v_src)
            replay.delta[part] = replay.rewards[part] + future - q_src
        replay.stale_delta = 0

    def _cause(self, loss: float) -> str:
        replay = self._replay
        where = f"step {self._steps} (episode {self._episode})"
        for name in ("observations", "next_observations", "rewards"):
            if not np.isfinite(getattr(replay, name)[: replay.size]).all():
                return f"the loss is {loss} at {where}: the environment returned {name} that are not finite"
        return f"the loss is {loss} at {where}: the values diverged (learning_rate {self._settings.learning_rate:g})"

    def evaluate(self) -> EvalPoint:
        """The mean greedy return now, over episodes that training never sees."""
        count = self._settings.evaluation_episodes
        while len(self._evaluation_envs) < count:
            self._evaluation_envs.append(Environment(make_env(self._task)))
        seeds = [_seed(self._rngs["evaluation_env"]) for _ in range(count)]
        returns = greedy_returns(self._evaluation_envs, seeds, self._preferences, self._settings.gamma)
        training = self._returns / self._since if self._since else None
        undiscounted, discounted = (float(values.mean()) for values in returns)
        point = EvalPoint(self._episode, self._steps, undiscounted, discounted, training, self._statistics())
        if undiscounted >= self._best_return:
            self._best, self._best_return = self._q.vector(), undiscounted
        self._losses, self._updates, self._returns, self._since = 0.0, 0, 0.0, 0
        return point

    def _preferences(self, observations: F32) -> F32:
        """What greedy evaluation maximises: Q, plus the potential where Q was learned under a shaped reward."""
        values = self._q.rows(observations)
        shaped = isinstance(self._settings, ExplicitShaping) and self._settings.evaluation_policy == "shaped"
        if self._advice is not None and (shaped or self._shapes_reward):
            values += self._advice.rows(observations)
        return values

    def _statistics(self) -> dict[str, float]:
        statistics = {"epsilon": self._epsilon()}
        if self._updates:
            statistics["loss"] = self._losses / self._updates
        if self._advice is None:
            return statistics
        statistics["kappa"] = self._advice.kappa
        replay = self._replay
        if not replay.size:
            return statistics
        spread = np.linspace(0, replay.size - 1, min(replay.size, self._settings.batch_size)).astype(np.int64)
        states = replay.observations[spread]
        statistics["advice_factor"] = float((self._advice.kappa * self._advice.factor(states)).mean())
        if self._delta is not None:
            largest = self._advice.largest_delta(states)
            statistics["delta_mean"] = float(largest.mean())
            statistics["delta_median"], statistics["delta_p90"] = (float(np.quantile(largest, q)) for q in (0.5, 0.9))
        return statistics

    def knowledge(self) -> Knowledge:
        """The last and the best-evaluated Q, for a later transfer."""
        return Knowledge(
            {
                "sizes": self._q.sizes.copy(),
                "last": self._q.vector(),
                "best": self._best.copy(),
                "best_return": np.array(self._best_return),
                "steps": np.array(self._steps, dtype=np.int64),
            }
        )

    _COUNTS = ("_episode", "_steps", "_losses", "_updates", "_returns", "_since", "_best_return")

    def state(self) -> dict[str, Any]:
        """Everything that decides how training goes on, between two episodes."""
        return {
            "counts": {name: getattr(self, name) for name in self._COUNTS},
            "rngs": {role: rng.bit_generator.state for role, rng in self._rngs.items()},
            "q": self._q.state(),
            "target": self._target.state(),
            "delta": {} if self._delta is None else self._delta.state(),
            "kappa": 0.0 if self._advice is None else self._advice.kappa,
            "replay": self._replay.state(),
            "best": self._best.copy(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go back to what `state` returned; what follows is then equal bit for bit."""
        for name in self._COUNTS:
            setattr(self, name, state["counts"][name])
        for role, rng in self._rngs.items():
            rng.bit_generator.state = state["rngs"][role]
        self._q.restore(state["q"])
        self._target.restore(state["target"])
        if self._delta is not None:
            self._delta.restore(state["delta"])
        if self._advice is not None:
            self._advice.kappa = float(state["kappa"])
        self._replay.restore(state["replay"])
        self._best[:] = state["best"]


def decay_constant(settings: DQN, steps: int) -> float:
    """C of eq. (6), so that the advice ends after the share `advice_fraction` of the source run's steps; 0: never."""
    if not isinstance(settings, ExplicitShaping):
        return 0.0
    if steps < 1:
        raise InputError(f"the source run must have taken at least one step (got {steps})")
    return 1.0 / (settings.advice_fraction * steps)


def _chosen(values: F32, actions: Any) -> F32:
    result: F32 = np.take_along_axis(values, actions[:, None], axis=1)[:, 0]
    return result


def _seed(rng: np.random.Generator) -> int:
    return int(rng.integers(2**31))
