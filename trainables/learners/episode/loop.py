"""The compiled episodes of a learner, and the conditions for them."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from trainables.agents.builtin.dqn import DQN
from trainables.learners.advice import Advice, ExplicitShaping, Follows, SourceAdvantage
from trainables.learners.episode.kernel import (
    ACT,
    ADVICE_ENDED,
    DELTA_UPDATES,
    DRAW,
    ENDED,
    GO_ON,
    HEAD,
    KAPPA,
    LEFT,
    LOSS,
    LOSSES,
    NEXT,
    Q_UPDATES,
    REFRESH,
    RETURNS,
    SIZE,
    STALE,
    STALE_DELTA,
    STEPS,
    UPDATES,
    Options,
    play,
)
from trainables.learners.replay_buffer import Replay
from trainables.learners.targets import TargetCache
from trainables.networks.network import Network
from trainables.networks.numba_qnetwork import QNetwork
from trainables.numerics.matmul import F32
from trainables.tasks.step_env import Environment


class Progress(NamedTuple):
    """The state of training: steps so far, and losses, updates and returns since the last evaluation."""

    steps: int
    losses: float
    updates: int
    returns: float


class EpisodeLoop:
    """The compiled episodes of one learner, which change its networks, replay buffer, targets and advice."""

    def __init__(
        self,
        settings: DQN,
        env: Environment,
        exploration: np.random.Generator,
        replay: Replay,
        targets: TargetCache,
        advice: Advice,
        q: QNetwork,
        target: QNetwork,
        delta: QNetwork | None,
    ) -> None:
        self._settings, self._env, self._rng = settings, env, exploration
        self._replay, self._targets, self._advice = replay, targets, advice
        self._q, self._target, self._delta = q, target, delta
        self._counts, self._sums = np.zeros(13, np.int64), np.zeros(4)
        self._refreshes = type(targets) is TargetCache and type(advice).shape_reward is Advice.shape_reward
        self._seen, self._after = (np.zeros(env.inputs, np.float32) for _ in range(2))

    def episode(
        self, observation: F32, epsilon: float, progress: Progress, remembered: Callable[[], F32]
    ) -> tuple[Progress, float]:
        """Train for the episode that begins with `observation`; return the progress and 0.

        In place of 0 the loss, where it is not finite and the episode was aborted. remembered: returns states from the
        replay buffer, called when the advice ends.
        """
        counts, sums, replay = self._counts, self._sums, self._replay
        counts[GO_ON], counts[LEFT] = ACT, self._env.time_limit
        counts[STEPS], sums[LOSSES], counts[UPDATES], sums[RETURNS] = progress
        self._seen[:] = observation
        while True:
            why = self._play(epsilon)
            if why == REFRESH:
                self._targets.refresh(replay)
            elif why == DRAW:
                replay.draw()
            elif why == ADVICE_ENDED:
                self._advice.end(remembered())
            else:
                loss = 0.0 if why == ENDED else float(sums[LOSS])
                reached = int(counts[STEPS]), float(sums[LOSSES]), int(counts[UPDATES]), float(sums[RETURNS])
                return Progress(*reached), loss

    def _play(self, epsilon: float) -> int:
        counts, sums, env, replay, targets = self._counts, self._sums, self._env, self._replay, self._targets
        q, advice, simulator = self._q, self._advice, self._env.simulator
        assert simulator is not None
        follows = advice.follows()
        source = follows.source if isinstance(follows.source, QNetwork) else q
        delta = q if self._delta is None else self._delta
        counts[SIZE], counts[HEAD], counts[NEXT] = replay.size, replay.head, replay.next
        counts[STALE], counts[STALE_DELTA] = targets.stale, targets.stale_delta
        counts[Q_UPDATES], counts[DELTA_UPDATES], sums[KAPPA] = q.updates, delta.updates, advice.kappa
        why = play(
            counts, sums, self._rng, self._options(epsilon, follows), simulator.physics, env.state,
            self._seen, self._after, replay.memory, replay.drawn, targets.targets, replay.batch, replay.batch_targets,
            *q.trained, q.read[1], self._target.read[0], *delta.trained, delta.read[1], *source.read,
            follows.fixed_delta, advice.advised,
        )  # fmt: skip
        replay.size, replay.head, replay.next = int(counts[SIZE]), int(counts[HEAD]), int(counts[NEXT])
        targets.stale, targets.stale_delta = int(counts[STALE]), int(counts[STALE_DELTA])
        q.updates = int(counts[Q_UPDATES])
        if self._delta is not None:
            self._delta.updates = int(counts[DELTA_UPDATES])
        advice.kappa = float(sums[KAPPA])
        return int(why)

    def _options(self, epsilon: float, follows: Follows) -> Options:
        settings, advice = self._settings, self._advice
        epsilon_start, epsilon_decay = settings.epsilon_schedule
        return Options(
            epsilon,
            settings.epsilon_unit == "steps",
            settings.epsilon_end,
            epsilon_start - settings.epsilon_end,
            epsilon_decay,
            settings.target_update,
            settings.truncation == "terminal",
            follows.source is not None,
            follows.delta is not None,
            self._delta is not None and not advice.delta_rests,
            self._refreshes,
            np.float32(settings.gamma),
            advice.decrement,
            settings.double,
        )


def episode_loop(
    settings: DQN,
    env: Environment,
    exploration: np.random.Generator,
    replay: Replay,
    targets: TargetCache,
    advice: Advice,
    q: Network,
    target: Network,
    delta: Network | None,
    advised: bool = True,
) -> EpisodeLoop | None:
    """Return the compiled episodes of a learner, or None where a part of it is not compiled.

    Such parts are an environment without simulator, a network of torch, and a custom strategy of advice; with
    `advised` False the advice has ended, and its strategy does not matter.
    """
    kind = type(advice)
    known = kind.decay in (Advice.decay, ExplicitShaping.decay)
    if advised:
        known &= kind.best in (Advice.best, SourceAdvantage.best)
        known &= kind.guided is Advice.guided and kind.learn is Advice.learn
    known &= not settings.double or kind.shape_reward is Advice.shape_reward
    if env.simulator is None or not known:
        return None
    networks = q, target, q if delta is None else delta, advice.follows().source or q
    if not all(isinstance(network, QNetwork) for network in networks):
        return None
    return EpisodeLoop(settings, env, exploration, replay, targets, advice, *networks[:2], delta)  # type: ignore[arg-type]
