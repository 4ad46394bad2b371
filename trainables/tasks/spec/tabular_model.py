"""The data of a tabular task: sampled dynamics for training, and the exact transition model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # light to import: code that makes a model imports these anyway
    import numpy as np
    from numpy.typing import NDArray
    from scipy.sparse import csr_array


@dataclass(frozen=True)
class Dynamics:
    """The arguments of the compiled step function of a tabular task (see `tabular_env.step`)."""

    kind: int
    """The step function."""
    parameters: NDArray[np.float64]
    """Its parameters; each step function defines their order."""
    start: int
    states: int
    actions: int
    time_limit: int
    """Steps until an episode is truncated."""


@dataclass(frozen=True)
class TransitionModel:
    """p(s'|s,a) and r(s,a) of a task with S states and A actions.

    Terminal states have empty rows, so their value is 0 in every equation without a special case.
    """

    transitions: csr_array
    """(S * A, S): row s * A + a holds p(.|s,a)."""
    rewards: NDArray[np.float64]
    """(S, A): the expected reward of one step."""
    start: int
    time_limit: int
    """Steps until an episode is truncated."""

    @property
    def terminal(self) -> NDArray[np.bool_]:
        """(S,): whether a state is terminal."""
        import numpy as np

        actions = self.rewards.shape[1]
        result: NDArray[np.bool_] = np.diff(self.transitions.indptr[::actions]) == 0
        return result

    def expected_next(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return sum_s' p(s'|s,a) values(s'), (S, A), for `values` (S,)."""
        result: NDArray[np.float64] = (self.transitions @ values).reshape(self.rewards.shape)
        return result
