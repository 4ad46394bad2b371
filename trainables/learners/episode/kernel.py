"""The steps of an episode of a deep agent as one compiled function, around a compiled simulator.

It must equal `DeepLearner._step` bit for bit: the same steps in the same order, by the same kernels. The numbers in the
comments of `play` are the lines of Algorithm 2. Rare events stay in Python: `play` returns with the reason, and is
called again to continue.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trainables.delta.sample import delta_sample
from trainables.learners.advice import best_action
from trainables.learners.advice_statistics import take_note
from trainables.learners.replay_buffer import Batch, Memory, gather
from trainables.learners.targets import td_target
from trainables.networks import mlp
from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32
from trainables.tasks.simulators.simulator import step

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

GO_ON, ACTION, OVER, STEPS, UPDATES, LEFT, SIZE, HEAD, NEXT, STALE, STALE_DELTA, Q_UPDATES, DELTA_UPDATES = range(13)
"""Places in `counts`."""
LOSSES, RETURNS, KAPPA, LOSS = range(4)
"""Places in `sums`."""
ACT, MOVE, SAMPLE, FILL, COUNT = range(5)
"""Where in a step `play` continues."""
ENDED, ADVICE_ENDED, DRAW, REFRESH, NOT_FINITE = range(5)
"""Why `play` returned."""


_update: Any = mlp.update
_outputs: Any = mlp.outputs
"""Without types, since their first arguments come as tuples."""


class Options(NamedTuple):
    """The constants of one call of `play`."""

    epsilon: float
    by_steps: bool
    """Whether epsilon depends on the step, by the three numbers below, instead of `epsilon`."""
    epsilon_end: float
    epsilon_span: float
    epsilon_decay: float
    target_update: int
    cut_truncated: bool
    """Whether a truncated step counts as terminal."""
    advised: bool
    """Whether a source gives advice while kappa is not 0."""
    follows_delta: bool
    """Whether the advice uses the delta network instead of a fixed delta."""
    learns_delta: bool
    refreshes: bool
    """Whether stale targets are computed here, which needs unshaped rewards."""
    gamma: np.float32
    decrement: float
    """C of eq. (6)."""
    double: bool
    """Whether TD targets are double DQN's: computed for each minibatch, and never cached."""


@compiled
def _row(sizes: I64, parameters: F32, observation: F32, room: F32) -> F32:
    at = mlp.single(sizes, parameters, observation, room)
    return room[at : at + sizes[-1]]


@compiled
def _remember(
    counts: I64, memory: Memory, seen: F32, action: int, reward: float, after: F32, end: bool, cut: bool
) -> None:
    at, capacity = counts[HEAD], len(memory.actions)
    memory.observations[at] = seen
    memory.next_observations[at] = after
    memory.actions[at] = action
    memory.rewards[at] = reward
    memory.terminated[at] = end
    memory.cut[at] = cut
    counts[HEAD] = at + 1 if at + 1 < capacity else 0
    counts[SIZE] = min(counts[SIZE] + 1, capacity)
    counts[STALE] = min(counts[STALE] + 1, counts[SIZE])
    counts[STALE_DELTA] = min(counts[STALE_DELTA] + 1, counts[SIZE])


@compiled
def _td_targets(target: Any, gamma: np.float32, memory: Memory, start: int, stop: int, targets: F32) -> None:
    """Compute the targets of Q, line 10, for the transitions from `start` to `stop`."""
    values = np.empty((stop - start, target[0][-1]), np.float32)
    _outputs(*target, memory.next_observations[start:stop], values)
    for i in range(start, stop):
        v_next = np.float32(0.0) if memory.cut[i] else values[i - start].max()
        targets[0, i] = td_target(memory.rewards[i], gamma, v_next)


@compiled
def _double_targets(q: Any, target: Any, gamma: np.float32, memory: Memory, batch: Batch, batch_targets: F32) -> None:
    """Make the TD targets of a minibatch double DQN's, as `targets.double_targets` does."""
    count = len(batch.indices)
    after = np.empty((count, memory.next_observations.shape[1]), np.float32)
    for j in range(count):
        after[j] = memory.next_observations[batch.indices[j]]
    choosing = np.empty((count, target[0][-1]), np.float32)
    values = np.empty_like(choosing)
    _outputs(q[0], q[1], q[4], after, choosing)
    _outputs(*target, after, values)
    for j in range(count):
        i = batch.indices[j]
        v_next = np.float32(0.0) if memory.cut[i] else values[j, choosing[j].argmax()]
        batch_targets[0, j] = td_target(memory.rewards[i], gamma, v_next)


@compiled
def _delta_targets(source: Any, gamma: np.float32, memory: Memory, start: int, stop: int, targets: F32) -> None:
    """Compute the targets of delta, eq. (4), for the transitions from `start` to `stop`."""
    here = np.empty((stop - start, source[0][-1]), np.float32)
    after = np.empty_like(here)
    _outputs(*source, memory.observations[start:stop], here)
    _outputs(*source, memory.next_observations[start:stop], after)
    for i in range(start, stop):
        v_next = np.float32(0.0) if memory.terminated[i] else after[i - start].max()
        targets[1, i] = delta_sample(memory.rewards[i], gamma, v_next, here[i - start, memory.actions[i]])


@compiled
def _refresh(counts: I64, options: Options, memory: Memory, targets: F32, target: Any, source: Any) -> None:
    """Compute stale targets like `TargetCache.refresh`; the newest transitions are before `head`, in a ring."""
    head, capacity, gamma = counts[HEAD], len(memory.actions), options.gamma
    count = 0 if options.double else counts[STALE]
    if count > head:
        _td_targets(target, gamma, memory, capacity - (count - head), capacity, targets)
    _td_targets(target, gamma, memory, max(head - count, 0), head, targets)
    counts[STALE] = 0
    if options.learns_delta:
        count = counts[STALE_DELTA]
        if count > head:
            _delta_targets(source, gamma, memory, capacity - (count - head), capacity, targets)
        _delta_targets(source, gamma, memory, max(head - count, 0), head, targets)
        counts[STALE_DELTA] = 0


@compiled
def _choose(
    counts: I64,
    sums: F64,
    rng: np.random.Generator,
    options: Options,
    actions: int,
    seen: F32,
    q: Any,
    q_room: F32,
    delta: Any,
    delta_room: F32,
    source: Any,
    source_room: F32,
    fixed_delta: F32,
    advised: F64,
) -> int:
    """Return the epsilon-greedy action on the values of eq. (5)."""
    epsilon = options.epsilon
    if options.by_steps:
        epsilon = options.epsilon_end + options.epsilon_span * math.exp(-counts[STEPS] / options.epsilon_decay)
    if rng.random() < epsilon:
        return int(rng.integers(0, actions))
    values = _row(q[0], q[1], seen, q_room)
    if not options.advised or sums[KAPPA] == 0.0:
        return int(values.argmax())
    q_src = _row(source[0], source[1], seen, source_room)
    reach = _row(delta[0], delta[1], seen, delta_room) if options.follows_delta else fixed_delta
    take_note(advised, reach, reach)
    return best_action(values, q_src, reach, sums[KAPPA])


@compiled
def _fill(counts: I64, memory: Memory, drawn: I64, targets: F32, batch: Batch, batch_targets: F32) -> bool:
    """Fill the minibatch drawn last, and return whether a target in it is stale."""
    return gather(
        drawn[counts[NEXT]], memory.observations, memory.actions, targets,
        batch.indices, batch.observations, batch.actions, batch_targets,
        counts[SIZE], counts[HEAD], counts[STALE],
    )  # fmt: skip


@compiled
def _learn(
    counts: I64, sums: F64, learns_delta: bool, batch: Batch, q: Any, q_last: Any, delta: Any, delta_last: Any
) -> bool:
    """Update both networks, and return whether the loss is finite."""
    x, actions, delta_loss = batch.observations, batch.actions, 0.0
    if learns_delta:  # 8, eq. (4)
        counts[DELTA_UPDATES] += 1
        delta_loss = _update(*delta, x, actions, batch.delta_targets, counts[DELTA_UPDATES], *delta_last)
    counts[Q_UPDATES] += 1
    loss = _update(*q, x, actions, batch.td_targets, counts[Q_UPDATES], *q_last)  # 10
    if not math.isfinite(loss + delta_loss):
        sums[LOSS] = loss + delta_loss
        return False
    sums[LOSSES] += loss
    counts[UPDATES] += 1
    return True


@compiled
def play(
    counts: I64,
    sums: F64,
    rng: np.random.Generator,
    options: Options,
    physics: tuple[int, F64, F64],
    state: F64,
    seen: F32,
    after: F32,
    memory: Memory,
    drawn: I64,
    targets: F32,
    batch: Batch,
    batch_targets: F32,
    q: Any,
    q_last: Any,
    q_room: F32,
    target: Any,
    delta: Any,
    delta_last: Any,
    delta_room: F32,
    source: Any,
    source_room: F32,
    fixed_delta: F32,
    advised: F64,
) -> int:
    """Continue an episode until it ends or Python has to act, and return the reason.

    q, delta, and each with _last: the arguments of `mlp.update` before and after the minibatch. target, source: the
    first arguments of `mlp.outputs`. Each begins with the sizes and the parameters.
    """
    kind, parameters, controls = physics
    while True:
        if counts[GO_ON] == ACT:
            counts[ACTION] = _choose(
                counts, sums, rng, options, len(controls), seen,
                q, q_room, delta, delta_room, source, source_room, fixed_delta, advised,
            )  # 4  # fmt: skip
            before = sums[KAPPA]  # 5
            sums[KAPPA] = max(0.0, before - options.decrement)
            counts[GO_ON] = MOVE
            if sums[KAPPA] == 0.0 and before > 0.0:
                return ADVICE_ENDED
        if counts[GO_ON] == MOVE:
            action = counts[ACTION]
            reward, terminated = step(kind, parameters, controls[action], state, after)  # 6
            counts[LEFT] -= 1
            truncated = counts[LEFT] <= 0
            counts[OVER] = terminated or truncated
            sums[RETURNS] += reward
            cut = terminated or (truncated and options.cut_truncated)
            _remember(counts, memory, seen, action, reward, after, terminated, cut)  # 7
            seen[:] = after
            counts[GO_ON] = SAMPLE if counts[SIZE] >= len(batch.actions) else COUNT
        if counts[GO_ON] == SAMPLE:  # 9
            counts[NEXT] += 1
            counts[GO_ON] = FILL
            if counts[NEXT] >= len(drawn):
                return DRAW
        if counts[GO_ON] == FILL:
            if _fill(counts, memory, drawn, targets, batch, batch_targets):
                if not options.refreshes:
                    return REFRESH
                _refresh(counts, options, memory, targets, target, source)
                _fill(counts, memory, drawn, targets, batch, batch_targets)
            if options.double:
                _double_targets(q, target, options.gamma, memory, batch, batch_targets)
            if not _learn(counts, sums, options.learns_delta, batch, q, q_last, delta, delta_last):  # 8, 10
                return NOT_FINITE
            counts[GO_ON] = COUNT
        counts[STEPS] += 1  # 11
        counts[GO_ON] = ACT
        if counts[STEPS] % options.target_update == 0:
            target[1][:] = q[1]
            counts[STALE] = counts[SIZE]
        if counts[OVER]:
            return ENDED
