"""The learner of the tabular agents: Q-learning and every use of Q_src, in one episode loop.

The loop is Algorithm 1 of the paper with the test in line 4 replaced by that of the agent (`Reuse`); the numbers in its
comments are the lines of that algorithm.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trainables.agents.builtin.gates import ConfidenceGate, DeltaGate
from trainables.agents.builtin.ppr import ProbabilisticPolicyReuse
from trainables.agents.builtin.q_learning import QLearning, Transfer
from trainables.cell import Cell
from trainables.curve import EvalPoint
from trainables.delta import tabular_estimator
from trainables.delta.noise_floor import noise_floor
from trainables.delta.sample import delta_sample
from trainables.delta.tabular_estimator import DeltaRule, DeltaTable
from trainables.evaluation import expected_return
from trainables.knowledge import Knowledge
from trainables.learners.tabular_state import InPlace
from trainables.numerics.jit import compiled
from trainables.numerics.rng import stream
from trainables.tasks.registry import model_of, parse_task
from trainables.tasks.spec.tabular_model import Dynamics
from trainables.tasks.tabular_env import step as env_step


class Reuse(IntEnum):
    """When a step takes the source policy's action."""

    NEVER = 0
    ALWAYS = 1
    PSI = 2
    """With probability psi."""
    GATE = 3
    """While no pair is over the threshold."""


class Tables(NamedTuple):
    """The tables that the loop reads and writes. Arrays are (S, A) unless stated."""

    q: NDArray[np.float64]
    """Q_trg."""
    q_src: NDArray[np.float64]
    v_src: NDArray[np.float64]
    """(S,): max_b Q_src(s,b)."""
    pi_src: NDArray[np.int64]
    """(S,): argmax_b Q_src(s,b)."""
    delta: DeltaTable


class Rule(NamedTuple):
    """The constants of eq. (1), and those of the agent."""

    reuse: int
    has_source: bool
    learning_rate: float
    gamma: float
    truncation_is_terminal: bool
    delta: DeltaRule


class Counts(NamedTuple):
    """Running counts, each in an array of one element, to which the loop can add."""

    over: NDArray[np.int64]
    """Pairs over the threshold now; the gate is open iff 0."""
    flips: NDArray[np.int64]
    """How often the gate opened or closed."""
    open_steps: NDArray[np.int64]
    steps: NDArray[np.int64]


@compiled
def run_episodes(
    kind: int,
    parameters: NDArray[np.float64],
    start: int,
    time_limit: int,
    tables: Tables,
    rule: Rule,
    counts: Counts,
    epsilons: NDArray[np.float64],
    psis: NDArray[np.float64],
    env_rng: np.random.Generator,
    explore_rng: np.random.Generator,
) -> float:
    """Train for len(epsilons) episodes, each with its epsilon and psi; return the sum of their returns."""
    total = 0.0
    actions = tables.q.shape[1]
    for episode in range(len(epsilons)):
        state = start
        for t in range(time_limit):  # 3
            gate_open = counts.over[0] == 0
            if rule.reuse == Reuse.ALWAYS:
                follow = True
            elif rule.reuse == Reuse.PSI:
                follow = explore_rng.random() < psis[episode]
            else:
                follow = rule.reuse == Reuse.GATE and gate_open  # 4
            if follow:
                action = tables.pi_src[state]  # 5
            elif explore_rng.random() < epsilons[episode]:  # 7
                action = int(explore_rng.integers(0, actions))
            else:
                action = np.argmax(tables.q[state])
            next_state, reward, terminated = env_step(kind, state, action, parameters, env_rng)  # 9
            total += reward
            if rule.has_source:  # 10, eq. (2)
                v_next = 0.0 if terminated else tables.v_src[next_state]
                sample = delta_sample(reward, rule.gamma, v_next, tables.q_src[state, action])
                counts.over[0] += tabular_estimator.update(tables.delta, rule.delta, state, action, sample)
                counts.flips[0] += (counts.over[0] == 0) != gate_open
            cut = terminated or (rule.truncation_is_terminal and t == time_limit - 1)
            future = 0.0 if cut else rule.gamma * np.max(tables.q[next_state])
            tables.q[state, action] += rule.learning_rate * (reward + future - tables.q[state, action])  # 11, eq. (1)
            counts.open_steps[0] += follow
            counts.steps[0] += 1
            state = next_state
            if terminated:
                break
    return total


class TabularLearner(InPlace):
    """The learner of one cell of a tabular agent: its tables, counts and random streams."""

    def __init__(self, cell: Cell, source: Knowledge | None) -> None:
        settings = cell.settings
        assert isinstance(settings, QLearning)
        self._settings = settings
        self._dynamics = parse_task(cell.task).dynamics()
        self._model = model_of(cell.task)
        self._tables = _tables(settings, self._dynamics, source)
        self._rule = _rule(settings, source is not None)
        self._calibrated = bool(cell.sources) and getattr(settings, "threshold", None) == "auto"
        if self._calibrated:
            self._rule = self._rule._replace(delta=calibrated(cell, self._tables.q_src, self._rule.delta))
        self._counts = Counts(*(np.zeros(1, np.int64) for _ in Counts._fields))
        self._env_rng = stream(cell.seed, "training_env", cell.task)
        self._explore_rng = stream(cell.seed, "exploration", cell.task)
        self._episode = 0
        self._training_return: float | None = None
        self._seen = (0, 0)
        self._evaluated: tuple[bytes, tuple[float, float]] = (b"", (0.0, 0.0))

    def _train(self, numbers: NDArray[np.int64], epsilons: NDArray[np.float64]) -> float:
        dynamics = self._dynamics
        return run_episodes(
            dynamics.kind,
            dynamics.parameters,
            dynamics.start,
            dynamics.time_limit,
            self._tables,
            self._rule,
            self._counts,
            epsilons,
            self._psi(numbers),
            self._env_rng,
            self._explore_rng,
        )

    def evaluate(self) -> EvalPoint:
        """Return a point with the exact return of the greedy policy, and delta's statistics since the last call."""
        policy = self.policy()
        key = policy.tobytes()
        if key != self._evaluated[0]:
            self._evaluated = key, expected_return(self._model, policy, self._settings.gamma)
        returns = self._evaluated[1]
        statistics = self._statistics()
        steps = int(self._counts.steps[0])
        self._seen = steps, int(self._counts.open_steps[0])
        return EvalPoint(self._episode, steps, *returns, self._training_return, statistics)

    def knowledge(self) -> Knowledge:
        """Return Q_trg, for a later transfer."""
        return Knowledge({"q": self._tables.q.copy()})

    def _arrays(self) -> dict[str, NDArray[Any]]:
        delta = {f"delta_{name}": array for name, array in self._tables.delta._asdict().items()}
        return {"q": self._tables.q, **delta, **self._counts._asdict()}

    def policy(self) -> NDArray[np.int64]:
        """Return the policy of greedy evaluation, (S,).

        Gated agents: the source's while the gate is open. Direct reuse: the source's. Others: argmax Q_trg.
        """
        gate_open = self._rule.reuse == Reuse.GATE and self._counts.over[0] == 0
        if gate_open or self._rule.reuse == Reuse.ALWAYS:
            return self._tables.pi_src
        greedy: NDArray[np.int64] = self._tables.q.argmax(axis=1)
        return greedy

    def _psi(self, episodes: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return psi_e = psi_start nu^e, as a product from the first episode on."""
        if not isinstance(self._settings, ProbabilisticPolicyReuse):
            return np.zeros(len(episodes))
        factors = np.full(int(episodes[-1]) + 1, self._settings.nu)
        factors[0] = self._settings.psi_start
        psis: NDArray[np.float64] = np.multiply.accumulate(factors)[episodes[0] :]
        return psis

    def _statistics(self) -> dict[str, float]:
        if not self._rule.has_source:
            return {}
        counts = self._counts
        steps, followed = int(counts.steps[0]) - self._seen[0], int(counts.open_steps[0]) - self._seen[1]
        statistics = {"max_abs_delta": float(np.max(np.abs(self._tables.delta.delta)))}
        if self._rule.reuse == Reuse.GATE:
            gate_open = float(counts.over[0] == 0)
            statistics["pairs_over_threshold"] = float(counts.over[0])
            statistics["gate_open"] = gate_open
            statistics["gate_open_share"] = followed / steps if steps else gate_open
            statistics["gate_flips"] = float(counts.flips[0])
        if self._calibrated:
            statistics["threshold"] = self._rule.delta.threshold
        if self._rule.reuse == Reuse.PSI:
            statistics["psi"] = float(self._psi(np.array([self._episode]))[0])
            statistics["source_action_share"] = followed / steps if steps else statistics["psi"]
        return statistics


def _tables(settings: QLearning, dynamics: Dynamics, source: Knowledge | None) -> Tables:
    shape = (dynamics.states, dynamics.actions)
    q_src = np.zeros(shape) if source is None else np.array(source.q_table(shape))
    q = q_src.copy() if settings.warm_start else np.zeros(shape)
    return Tables(q, q_src, q_src.max(axis=1), q_src.argmax(axis=1), tabular_estimator.empty_table(*shape))


def _rule(settings: QLearning, has_source: bool) -> Rule:
    threshold = settings.threshold if isinstance(settings, DeltaGate | ConfidenceGate) else math.inf
    confident = settings if isinstance(settings, ConfidenceGate) else None
    delta = DeltaRule(
        confident=confident is not None,
        learning_rate=settings.delta_learning_rate if isinstance(settings, Transfer) else 0.0,
        threshold=math.inf if threshold == "auto" else float(threshold),  # infinity until it is calibrated
        z=confident.z if confident else 0.0,
        min_visits=confident.min_visits if confident else 0,
        sd_floor=confident.sd_floor if confident else 0.0,
    )
    terminal = settings.truncation == "terminal"
    return Rule(int(Reuse[settings.reuse.upper()]), has_source, settings.learning_rate, settings.gamma, terminal, delta)


def calibrated(cell: Cell, q_src: NDArray[np.float64], rule: DeltaRule) -> DeltaRule:
    """Return the rule with the noise floor of the cell's source, over as many episodes as the cell has."""
    settings = cell.settings
    floor = noise_floor(cell.sources[0].task, q_src, rule, settings.gamma, settings.episodes, cell.seed)
    return rule._replace(threshold=floor)
