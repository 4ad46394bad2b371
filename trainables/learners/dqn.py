"""The learner of the deep agents: DQN, and Algorithm 2 with each use of a source, in one loop.

The numbers in the comments of `_step` and `_learn` are the lines of Algorithm 2.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from trainables.agents.builtin.dqn import DQN
from trainables.agents.named import entry
from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.delta.sample import delta_samples
from trainables.errors import TrainingError
from trainables.knowledge import Knowledge
from trainables.learners.advice import Advice, Run
from trainables.learners.episode.loop import EpisodeLoop, Progress, episode_loop
from trainables.learners.greedy_evaluation import greedy_returns
from trainables.learners.replay_buffer import Replay
from trainables.learners.targets import TargetCache, double_targets
from trainables.networks.network import Network, new_network, source_network
from trainables.numerics.matmul import F32
from trainables.numerics.rng import seed_sequence, stream
from trainables.tasks.make import make_env
from trainables.tasks.registry import parse_task
from trainables.tasks.step_env import Environment


class DeepLearner:
    """The learner of one cell of a deep agent: its networks, replay buffer, counts and random streams."""

    def __init__(self, cell: Cell, source: Knowledge | None) -> None:
        settings = cell.settings
        assert isinstance(settings, DQN)
        self._settings = settings
        self._task = parse_task(cell.task)
        self._env = Environment(make_env(self._task))
        self._rngs = {
            role: stream(cell.seed, role, cell.task) for role in ("training_env", "evaluation_env", "exploration")
        }
        replay_rng = stream(cell.seed, "replay", cell.task)
        self._replay = Replay(settings.replay_capacity, self._env.inputs, settings.batch_size, replay_rng)
        self._build_networks(cell)
        self._advice = self._make_advice(cell, source)
        self._targets = TargetCache(self._replay, self._target, self._advice, settings.gamma)
        self._evaluation_envs: list[Environment] = []
        self._episode = self._steps = 0
        self._losses, self._updates, self._returns, self._since = 0.0, 0, 0.0, 0  # since the last evaluation
        self._advice.begin(
            Run(cell, self._q, self._target, self._rngs["exploration"], self._remembered_states, self._replay)
        )
        self._best, self._best_return = self._q.vector(), -math.inf

    def _build_networks(self, cell: Cell) -> None:
        """Build the networks of line 2 of Algorithm 2, and the target network."""
        settings, shape = self._settings, (self._env.inputs, self._env.actions)
        generator = torch.Generator()
        generator.manual_seed(int(seed_sequence(cell.seed, "network_init", cell.task).generate_state(1)[0]))
        self._q = new_network(settings, *shape, settings.learning_rate, generator)
        self._target = new_network(settings, *shape, settings.learning_rate, shares_with=self._q)
        self._target.load_vector(self._q.vector())
        self._delta: Network | None = None
        if self._strategy.learns_delta:
            squared = settings.model_copy(update={"loss": "squared"})  # the loss of eq. (4), whatever that of Q
            rate = getattr(settings, "delta_learning_rate", settings.learning_rate)
            self._delta = new_network(squared, *shape, rate, generator, shares_with=self._q)

    @property
    def _strategy(self) -> type[Advice]:
        """Return the class that the hyperparameters name for the use of the source."""
        strategy: type[Advice] = entry(self._settings.advice)
        return strategy

    def _make_advice(self, cell: Cell, source: Knowledge | None) -> Advice:
        """Return the source's advice; none without a source, or where the agent uses none."""
        if source is None or not cell.sources:
            return Advice(self._settings)
        named = cell.sources[0]
        network = source_network(source, named.checkpoint, self._settings, self._env.inputs, self._env.actions, self._q)
        steps = int(source.arrays["steps"]) if named.steps is None else named.steps
        return self._strategy(self._settings, network, self._delta, steps)

    @property
    def steps(self) -> int:
        """Return the training steps so far."""
        return self._steps

    def run(self, episodes: int) -> None:
        """Train for `episodes` more episodes. Raises TrainingError where a number is no longer finite."""
        for _ in range(episodes):
            observation = self._env.reset(_seed(self._rngs["training_env"]))
            before = self._returns
            self._advice.episode(self._episode)
            done = self._run_compiled(observation)
            while not done:
                observation, done = self._step(observation)
            self._advice.ended(self._returns - before)
            self._episode += 1
        self._since += episodes

    def _run_compiled(self, observation: F32) -> bool:
        """Run an episode as one compiled function, equal to `_step` bit for bit; return whether there is one."""
        loop = self._late_loop if self._loop is None and not self._advice.kappa else self._loop
        if loop is None:
            return False
        before = Progress(self._steps, self._losses, self._updates, self._returns)
        after, loss = loop.episode(observation, self._epsilon(), before, self._remembered_states)
        self._steps, self._losses, self._updates, self._returns = after
        if not math.isfinite(loss):
            raise TrainingError(self._cause(loss))
        return True

    @functools.cached_property
    def _loop(self) -> EpisodeLoop | None:
        """Return the compiled episodes; None where `_step`, or a subclass's method, must take the steps."""
        return self._compiled(advised=True)

    @functools.cached_property
    def _late_loop(self) -> EpisodeLoop | None:
        """Return the compiled episodes for the time after the advice, whatever it was."""
        return self._compiled(advised=False)

    def _compiled(self, advised: bool) -> EpisodeLoop | None:
        parts = "_step", "_action", "_epsilon", "_learn"
        if any(getattr(type(self), name) is not getattr(DeepLearner, name) for name in parts):
            return None
        exploration, networks = self._rngs["exploration"], (self._q, self._target, self._delta)
        return episode_loop(
            self._settings, self._env, exploration, self._replay, self._targets, self._advice, *networks, advised
        )

    def _step(self, observation: F32) -> tuple[F32, bool]:
        action = self._action(observation)  # 4
        if self._advice.decay():  # 5
            self._advice.end(self._remembered_states())
        next_observation, reward, terminated, truncated = self._env.step(action)  # 6
        self._returns += reward
        cut = terminated or (truncated and self._settings.truncation == "terminal")
        self._replay.add(observation, action, reward, next_observation, terminated, cut)  # 7
        self._targets.added(self._replay.size)
        if self._replay.size >= self._settings.batch_size:
            self._learn()  # 8 to 10
        self._steps += 1  # 11
        if self._steps % self._settings.target_update == 0:
            self._target.load_vector(self._q.vector())
            self._targets.target_copied(self._replay.size)
        return next_observation, terminated or truncated

    def _action(self, observation: F32) -> int:
        """Return the epsilon-greedy action on the values of eq. (5), unless the source acts."""
        rng = self._rngs["exploration"]
        if self._advice.kappa and (guided := self._advice.guided(observation)) is not None:
            return guided
        if rng.random() < self._epsilon():
            return int(rng.integers(self._env.actions))
        q = self._q.row(observation)
        return self._advice.best(q, observation) if self._advice.kappa else int(q.argmax())

    def _epsilon(self) -> float:
        settings = self._settings
        n = self._episode if settings.epsilon_unit == "episodes" else self._steps
        start, decay = settings.epsilon_schedule
        return settings.epsilon_end + (start - settings.epsilon_end) * math.exp(-n / decay)

    def _learn(self) -> None:
        batch = self._replay.sample(self._targets)  # 9; one minibatch serves both networks
        if self._settings.double:
            double_targets(self._replay, batch, self._q, self._target, self._advice)
        delta_loss = 0.0
        if self._delta is not None and not self._advice.delta_rests:
            delta_loss = self._delta.update(batch.observations, batch.actions, batch.delta_targets)  # 8, eq. (4)
        if self._advice.kappa:  # 10
            loss = self._advice.learn(self._q, batch)
        else:
            loss = self._q.update(batch.observations, batch.actions, batch.td_targets)
        if not math.isfinite(loss + delta_loss):
            raise TrainingError(self._cause(loss + delta_loss))
        self._losses += loss
        self._updates += 1

    def _cause(self, loss: float) -> str:
        replay = self._replay
        where = f"step {self._steps} (episode {self._episode})"
        for name in ("observations", "next_observations", "rewards"):
            if not np.isfinite(getattr(replay.memory, name)[: replay.size]).all():
                return f"the loss is {loss} at {where}: the environment returned {name} that are not finite"
        return f"the loss is {loss} at {where}: the values diverged (learning_rate {self._settings.learning_rate:g})"

    def evaluate(self) -> EvalPoint:
        """Return a point with the mean greedy return, over episodes with a separate random stream."""
        count = self._settings.evaluation_episodes
        while len(self._evaluation_envs) < count:
            self._evaluation_envs.append(Environment(make_env(self._task)))
        seeds = [_seed(self._rngs["evaluation_env"]) for _ in range(count)]
        returns = greedy_returns(self._evaluation_envs, seeds, self.preferences, self._settings.gamma)
        training = self._returns / self._since if self._since else None
        undiscounted, discounted = (float(values.mean()) for values in returns)
        point = EvalPoint(self._episode, self._steps, undiscounted, discounted, training, self._statistics())
        if undiscounted >= self._best_return:
            self._best, self._best_return = self._advice.kept(self._q).vector(), undiscounted
        self._losses, self._updates, self._returns, self._since = 0.0, 0, 0.0, 0
        self._advice.advised[:] = 0.0
        return point

    def preferences(self, observations: F32) -> F32:
        """Return the values (n, actions) that greedy evaluation maximises, at observations (n, inputs)."""
        return self._advice.evaluated(self._q.rows(observations), observations)

    def _statistics(self) -> dict[str, float]:
        statistics = {"epsilon": self._epsilon()}
        if self._updates:
            statistics["loss"] = self._losses / self._updates
        source, advice = self._advice.source, self._advice
        if source is not None and self._replay.size:
            samples = delta_samples(source, self._replay.transitions(self._spread()), self._settings.gamma)
            statistics["delta_sample_median"] = float(np.median(np.abs(samples)))
        return statistics | advice.statistics(self._remembered_states()) | advice.advised_statistics()

    def _spread(self) -> NDArray[np.int64]:
        """Return the indices of a minibatch's number of transitions, spread evenly over the replay buffer."""
        size = self._replay.size
        return np.linspace(0, size - 1, min(size, self._settings.batch_size)).astype(np.int64)

    def _remembered_states(self) -> F32:
        """Return a minibatch's number of states, spread evenly over the replay buffer, (n, inputs)."""
        return self._replay.memory.observations[self._spread()]

    def knowledge(self) -> Knowledge:
        """Return the last and the best-evaluated Q, for a later transfer."""
        return Knowledge(
            {
                "sizes": self._q.sizes.copy(),
                "last": self._advice.kept(self._q).vector(),
                "best": self._best.copy(),
                "best_return": np.array(self._best_return),
                "steps": np.array(self._steps, dtype=np.int64),
            }
        )

    def close(self) -> None:
        """Close the environments."""
        for env in (self._env, *self._evaluation_envs):
            env.close()

    _COUNTS = ("_episode", "_steps", "_losses", "_updates", "_returns", "_since", "_best_return")

    def state(self) -> dict[str, Any]:
        """Return everything on which further training depends, between two episodes."""
        return {
            "counts": {name: getattr(self, name) for name in self._COUNTS},
            "rngs": {role: rng.bit_generator.state for role, rng in self._rngs.items()},
            "q": self._q.state(),
            "target": self._target.state(),
            "delta": {} if self._delta is None else self._delta.state(),
            "advice": self._advice.state(),
            "advised": self._advice.advised.copy(),
            "replay": self._replay.state(),
            "targets": self._targets.state(),
            "best": self._best.copy(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned; training then continues bit for bit as before."""
        for name in self._COUNTS:
            setattr(self, name, state["counts"][name])
        for role, rng in self._rngs.items():
            rng.bit_generator.state = state["rngs"][role]
        self._q.restore(state["q"])
        self._target.restore(state["target"])
        if self._delta is not None:
            self._delta.restore(state["delta"])
        self._advice.restore(state["advice"])
        self._advice.advised[:] = state.get(
            "advised", 0.0
        )  # a checkpoint of before it was counted was evaluated just then
        self._replay.restore(state["replay"])
        self._targets.restore(state["targets"])
        self._best[:] = state["best"]


def _seed(rng: np.random.Generator) -> int:
    return int(rng.integers(2**31))
