"""delta_select: of several sources, follow the one whose delta is smallest along its own path, or none.

Following source k from the start state has the discounted return V_src(s_0) + sum_t gamma^t delta_k(s_t, a_t): the
paper's identity Q_trg^pi - Q_src^pi = delta + gamma E[...], summed along the path. The first term is the return that
the source predicts; the second, its path delta, is learned here as a running mean over the episodes in which it was
followed. Neither the largest |delta| nor its mean distinguishes a source that is wrong in states that it never visits
from one that fails on its path.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trainables.agents.builtin.delta_select import DeltaSelect
from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.delta.sample import delta_sample
from trainables.evaluation import expected_return
from trainables.knowledge import Knowledge, parts
from trainables.learners.tabular_state import InPlace
from trainables.numerics.jit import compiled
from trainables.numerics.rng import stream
from trainables.tasks.registry import model_of, parse_task
from trainables.tasks.tabular_env import step as env_step

NONE = -1
"""No source: Q_trg itself."""


class Sources(NamedTuple):
    """The values and policies of the K sources of a library."""

    v: NDArray[np.float64]
    """(K, S): max_b Q_src(s,b)."""
    pi: NDArray[np.int64]
    """(K, S): argmax_b Q_src(s,b)."""


class PathDelta(NamedTuple):
    """Running means of path deltas, and of the returns of Q_trg."""

    followed: NDArray[np.int64]
    """(K,): episodes in which each source was followed."""
    mean: NDArray[np.float64]
    """(K,): its mean path delta."""
    squares: NDArray[np.float64]
    """(1,): squared deviations from these means, summed over all sources."""
    own: NDArray[np.float64]
    """(2,): the running mean of the discounted returns of Q_trg, and the first of them; -infinity before that."""
    steps: NDArray[np.int64]
    """(2,): all steps, and those that followed a source."""


class Rule(NamedTuple):
    """The agent's hyperparameters."""

    learning_rate: float
    gamma: float
    truncation_is_terminal: bool
    practice: float
    z: float
    sd_floor: float
    keep: float
    own_rate: float


@compiled
def worth_following(promise: float, value: float, own: NDArray[np.float64], keep: float) -> bool:
    """Return whether a source of this value beats Q_trg now, and keeps its predicted advantage over Q_trg untrained."""
    if value <= own[0]:
        return False
    return bool(own[1] == -np.inf or value - own[1] >= keep * (promise - own[1]))


@compiled
def choose(promises: NDArray[np.float64], paths: PathDelta, z: float, sd_floor: float, keep: float) -> int:
    """Return the source with the largest upper bound of promise + path delta, or NONE if none is worth following.

    promises (K,): V_src at the start. A source that was never followed comes first.
    """
    total, tried = 0, 0
    for k in range(len(promises)):
        if paths.followed[k] == 0:
            return k
        total += paths.followed[k]
        tried += 1
    sd = sd_floor
    if total > tried:
        sd = max(sd, math.sqrt(paths.squares[0] / (total - tried)))
    best, at = -np.inf, NONE
    for k in range(len(promises)):
        bound = promises[k] + paths.mean[k] + z * sd / math.sqrt(paths.followed[k])
        if bound > best and worth_following(promises[k], bound, paths.own, keep):
            best, at = bound, k
    return at


@compiled
def record_episode(paths: PathDelta, k: int, collected: float, own_rate: float) -> None:
    """Update the running means by an episode: the path delta of source k, or the return of Q_trg."""
    if k != NONE:
        paths.followed[k] += 1
        error = collected - paths.mean[k]
        paths.mean[k] += error / paths.followed[k]
        paths.squares[0] += error * (collected - paths.mean[k])
    elif paths.own[0] == -np.inf:
        paths.own[:] = collected
    else:
        paths.own[0] += own_rate * (collected - paths.own[0])


@compiled
def run_episodes(
    kind: int,
    parameters: NDArray[np.float64],
    start: int,
    time_limit: int,
    q: NDArray[np.float64],
    sources: Sources,
    paths: PathDelta,
    rule: Rule,
    epsilons: NDArray[np.float64],
    env_rng: np.random.Generator,
    explore_rng: np.random.Generator,
) -> float:
    """Train q (S, A) for len(epsilons) episodes, each with its epsilon; return the sum of their returns."""
    total = 0.0
    promises = sources.v[:, start].copy()
    for epsilon in epsilons:
        k = choose(promises, paths, rule.z, rule.sd_floor, rule.keep)
        if explore_rng.random() < rule.practice and (k == NONE or paths.followed[k] > 0):
            k = NONE
        state, discount, collected = start, 1.0, 0.0
        for t in range(time_limit):
            if k != NONE:
                action = sources.pi[k, state]
            elif explore_rng.random() < epsilon:
                action = int(explore_rng.integers(0, q.shape[1]))
            else:
                action = np.argmax(q[state])
            next_state, reward, terminated = env_step(kind, state, action, parameters, env_rng)
            total += reward
            cut = terminated or (rule.truncation_is_terminal and t == time_limit - 1)
            if k != NONE:  # a sample of delta, eq. (2): Q_src at the source's own action is V_src
                v_next = 0.0 if cut else sources.v[k, next_state]
                collected += discount * delta_sample(reward, rule.gamma, v_next, sources.v[k, state])
            else:
                collected += discount * reward
            discount *= rule.gamma
            future = 0.0 if cut else rule.gamma * np.max(q[next_state])
            q[state, action] += rule.learning_rate * (reward + future - q[state, action])  # eq. (1)
            paths.steps[0] += 1
            paths.steps[1] += k != NONE
            state = next_state
            if terminated:
                break
        record_episode(paths, k, collected, rule.own_rate)
    return total


class SelectLearner(InPlace):
    """The learner of delta_select: its tables, counts and random streams."""

    _settings: DeltaSelect

    def __init__(self, cell: Cell, source: Knowledge | None) -> None:
        settings = cell.settings
        assert isinstance(settings, DeltaSelect)
        assert source is not None
        self._settings, self._dynamics = settings, parse_task(cell.task).dynamics()
        self._model = model_of(cell.task)
        shape = self._dynamics.states, self._dynamics.actions
        tables = np.stack([part.q_table(shape) for part in parts(source, len(cell.sources))])
        self._sources = Sources(tables.max(axis=2), tables.argmax(axis=2))
        count = len(tables)
        self._paths = PathDelta(
            np.zeros(count, np.int64), np.zeros(count), np.zeros(1), np.full(2, -np.inf), np.zeros(2, np.int64)
        )
        self._q = np.zeros(shape)
        self._rule = Rule(
            settings.learning_rate,
            settings.gamma,
            settings.truncation == "terminal",
            settings.practice,
            settings.z,
            settings.sd_floor,
            settings.keep,
            settings.own_rate,
        )
        self._env_rng = stream(cell.seed, "training_env", cell.task)
        self._explore_rng = stream(cell.seed, "exploration", cell.task)
        self._episode, self._seen = 0, (0, 0)
        self._training_return: float | None = None

    def _train(self, numbers: NDArray[np.int64], epsilons: NDArray[np.float64]) -> float:
        dynamics = self._dynamics
        return run_episodes(
            dynamics.kind,
            dynamics.parameters,
            dynamics.start,
            dynamics.time_limit,
            self._q,
            self._sources,
            self._paths,
            self._rule,
            epsilons,
            self._env_rng,
            self._explore_rng,
        )

    def evaluate(self) -> EvalPoint:
        """Return a point with the exact return of the source that would be followed now, or of argmax Q_trg."""
        k = self._chosen()
        returns = expected_return(self._model, self.policy(), self._settings.gamma)
        steps, followed = (int(count) for count in self._paths.steps)
        share = (followed - self._seen[1]) / (steps - self._seen[0]) if steps > self._seen[0] else float(k != NONE)
        self._seen = steps, followed
        statistics = {"source": float(k), "source_action_share": share}
        if k != NONE:
            statistics["path_delta"] = float(self._paths.mean[k])
        return EvalPoint(self._episode, steps, *returns, self._training_return, statistics)

    def policy(self) -> NDArray[np.int64]:
        """Return the policy (S,) of the source that would be followed now, or argmax Q_trg."""
        k = self._chosen()
        policy: NDArray[np.int64] = self._q.argmax(axis=1) if k == NONE else self._sources.pi[k]
        return policy

    def knowledge(self) -> Knowledge:
        """Return Q_trg, for a later transfer."""
        return Knowledge({"q": self._q.copy()})

    def _arrays(self) -> dict[str, NDArray[Any]]:
        return {"q": self._q, **self._paths._asdict()}

    def _chosen(self) -> int:
        """Return the source with the largest promise + path delta of those followed and worth following, or NONE.

        Before any was followed, it is the one with the largest promise.
        """
        promises = self._sources.v[:, self._dynamics.start]
        if not self._paths.followed.any():
            return int(promises.argmax())
        values = np.where(self._paths.followed > 0, promises + self._paths.mean, -np.inf)
        for k in np.argsort(-values, kind="stable"):
            if worth_following(promises[k], values[k], self._paths.own, self._settings.keep):
                return int(k)
        return NONE
