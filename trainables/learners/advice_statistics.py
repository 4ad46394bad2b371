"""Statistics of advice, at the states where it acted and at states in the replay buffer."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from trainables.networks.network import Network
from trainables.numerics.jit import compiled
from trainables.numerics.matmul import F32

F64 = NDArray[np.float64]


@compiled
def take_note(advised: F64, delta: F32, exponent: F32) -> None:
    """Count an advised step in `advised`, at a state with these delta (actions,), or none, and this exponent (n,).

    advised: the steps, and sums over them of exp(-max |exponent|), of max_a |delta| and of exp(-max_a |delta|).
    """
    largest = 0.0
    for a in range(len(delta)):
        largest = max(largest, abs(float(delta[a])))
    own = 0.0
    for a in range(len(exponent)):
        own = max(own, abs(float(exponent[a])))
    advised[0] += 1.0
    advised[1] += math.exp(-own)
    advised[2] += largest
    advised[3] += math.exp(-largest)


NO_DELTA = np.zeros(0, np.float32)
"""delta without a delta network: its factor is 1."""


def advised_statistics(advised: F64, with_delta: bool) -> dict[str, float]:
    """Return the mean factor of the steps that `take_note` counted, and `with_delta` also max_a |delta|; {} of none.

    Where the factor is not the paper's exp(-max_a |delta|), the mean of that too.
    """
    steps, factors, sizes, papers = advised.tolist()
    if not steps:
        return {}
    found = {"advised_factor": factors / steps}
    if with_delta:
        found["advised_delta"] = sizes / steps
        if papers != factors:
            found["advised_paper_factor"] = papers / steps
    return found


def largest_delta(delta: Network, observations: F32) -> F32:
    """Return max_a |delta(s,a)| at each observation, (n,)."""
    result: F32 = np.abs(delta.rows(observations)).max(axis=1)
    return result


def delta_statistics(delta: Network, observations: F32) -> dict[str, float]:
    """Return the mean and the quantiles of max_a |delta(s,a)| over states (n, inputs); nothing of no state."""
    if not len(observations):
        return {}
    largest = largest_delta(delta, observations)
    median, p90 = (float(np.quantile(largest, share)) for share in (0.5, 0.9))
    return {"delta_mean": float(largest.mean()), "delta_median": median, "delta_p90": p90}
