"""A tabular learner in plain Python, as a base class for custom agents, which override how it acts or learns.

It has about a hundredth of the speed of the compiled loop.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from trainables.agents.builtin.q_learning import QLearning
from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.evaluation import expected_return
from trainables.knowledge import Knowledge
from trainables.numerics.rng import stream
from trainables.tasks.make import make_env
from trainables.tasks.registry import parse_task


class StepLearner:
    """Epsilon-greedy Q-learning, eq. (1), step by step. Override `act`, `learn` or `policy`."""

    settings: Any
    """The cell's hyperparameters."""
    q: NDArray[np.float64]
    """(S, A): Q_trg."""
    q_src: NDArray[np.float64]
    """(S, A): Q_src; zeros without a source."""
    rng: np.random.Generator
    """The random stream of the agent's actions."""
    epsilon: float
    """epsilon of this episode."""

    def __init__(self, cell: Cell, source: Knowledge | None) -> None:
        """Raise InputError for a source of another shape than the task's."""
        task = parse_task(cell.task)
        self.settings, self._model, self._env = cell.settings, task.model(), make_env(task)
        assert isinstance(self.settings, QLearning)
        shape = self._model.rewards.shape
        self.q = np.zeros(shape)
        self.q_src = np.zeros(shape) if source is None else np.array(source.q_table((shape[0], shape[1])))
        self.rng = stream(cell.seed, "exploration", cell.task)
        self._env.unwrapped.np_random = stream(cell.seed, "training_env", cell.task)
        self.epsilon = self.settings.epsilon_start
        self._episode = self._steps = 0
        self._return: float | None = None

    def act(self, state: int) -> int:
        """Return the action to take: epsilon-greedy on Q_trg."""
        if self.rng.random() < self.epsilon:
            return int(self.rng.integers(self.q.shape[1]))
        return int(self.q[state].argmax())

    def learn(self, state: int, action: int, reward: float, next_state: int, terminated: bool) -> None:
        """Learn from one step. terminated: whether `next_state` is terminal."""
        future = 0.0 if terminated else self.settings.gamma * self.q[next_state].max()
        self.q[state, action] += self.settings.learning_rate * (reward + future - self.q[state, action])

    def policy(self) -> NDArray[np.int64]:
        """Return the policy of greedy evaluation (S,): argmax Q_trg."""
        greedy: NDArray[np.int64] = self.q.argmax(axis=1)
        return greedy

    def statistics(self) -> dict[str, float]:
        """Return further statistics to report at an evaluation, by name."""
        return {}

    def run(self, episodes: int) -> None:
        """Train for `episodes` more episodes."""
        total = 0.0
        for _ in range(episodes):
            self.epsilon = max(self.settings.epsilon_start - self.settings.epsilon_decay * self._episode, 0.0)
            total += self._run_episode()
            self._episode += 1
        self._return = total / episodes

    def _run_episode(self) -> float:
        total, done = 0.0, False
        state, _ = self._env.reset()
        while not done:
            action = self.act(state)
            next_state, reward, terminated, truncated, _ = self._env.step(action)
            cut = terminated or (truncated and self.settings.truncation == "terminal")
            self.learn(state, action, float(reward), next_state, cut)
            total, state, done = total + float(reward), next_state, terminated or truncated
            self._steps += 1
        return total

    def evaluate(self) -> EvalPoint:
        """Return a point with the exact return of `policy`."""
        returns = expected_return(self._model, np.asarray(self.policy(), np.int64), self.settings.gamma)
        return EvalPoint(self._episode, self._steps, *returns, self._return, self.statistics())

    def close(self) -> None:
        """Close the environment."""
        self._env.close()

    def knowledge(self) -> Knowledge:
        """Return Q_trg, for a later transfer."""
        return Knowledge({"q": self.q.copy()})
