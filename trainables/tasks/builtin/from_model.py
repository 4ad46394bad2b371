"""Tabular tasks that are defined by an exact model, from which their steps are sampled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trainables.errors import InputError
from trainables.numerics.jit import compiled
from trainables.tasks.spec.tabular_model import Dynamics, TransitionModel

KIND = 2
HEADER = 3


@compiled
def step(state: int, action: int, parameters: NDArray[np.float64], rng: np.random.Generator) -> tuple[int, float, bool]:
    """Take a step; return (next state, reward, terminated).

    parameters: A, S * A and the number n of possible transitions; then, for the rows s * A + a, the row starts
    (S * A + 1), the next states (n), their cumulative probabilities in each row (n), and the rewards (S * A).
    """
    actions, rows, count = int(parameters[0]), int(parameters[1]), int(parameters[2])
    row = state * actions + action
    states = HEADER + rows + 1
    at, last = int(parameters[HEADER + row]), int(parameters[HEADER + row + 1]) - 1
    draw = rng.random()
    while at < last and draw >= parameters[states + count + at]:
        at += 1
    next_state = int(parameters[states + at])
    first = HEADER + next_state * actions
    return next_state, parameters[states + 2 * count + row], parameters[first] == parameters[first + actions]


def dynamics(model: TransitionModel) -> Dynamics:
    """Return the sampled dynamics of `model`."""
    states, actions = model.rewards.shape
    p = model.transitions
    added = np.concatenate([np.cumsum(p.data[a:b]) for a, b in zip(p.indptr, p.indptr[1:], strict=False)])
    header = (actions, states * actions, len(p.data))
    parameters = np.concatenate([header, p.indptr, p.indices, added, model.rewards.ravel()]).astype(np.float64)
    return Dynamics(KIND, parameters, model.start, states, actions, model.time_limit)


def checked(model: TransitionModel) -> TransitionModel:
    """Return the model. Raises InputError for wrong shapes, probabilities, rewards, start or time limit."""
    if not isinstance(model, TransitionModel):
        raise InputError(f"a model must be a TransitionModel (got {model!r})")
    states, actions = model.rewards.shape
    if model.transitions.shape != (states * actions, states):
        raise InputError(f"transitions must be {(states * actions, states)} for rewards {(states, actions)}")
    sums = np.asarray(model.transitions.sum(axis=1)).reshape(states, actions)
    live = ~model.terminal
    if len(model.transitions.data) and model.transitions.data.min() < 0:
        raise InputError("a transition has a negative probability")
    if not np.allclose(sums[live], 1.0, rtol=0, atol=1e-9):
        state, action = np.argwhere((np.abs(sums - 1) > 1e-9) & live[:, None])[0]
        raise InputError(
            f"the probabilities of state {state}, action {action} add up to {sums[state, action]:g}, not 1"
        )
    if not np.isfinite(model.rewards).all():
        raise InputError("a reward is not finite")
    if not (0 <= model.start < states and live[model.start]):
        raise InputError(f"the start must be a state that does not end the episode (got {model.start})")
    if model.time_limit < 1:
        raise InputError(f"time_limit must be at least 1 (got {model.time_limit})")
    return model
