"""Probabilistic policy reuse with networks."""

from __future__ import annotations

from typing import Any

import numpy as np

from trainables.agents.builtin.dqn import DQN
from trainables.learners.advice import Advice, Run
from trainables.networks.network import Network
from trainables.numerics.matmul import F32

NEGLIGIBLE = 1e-6
"""Probability below which the source is no longer followed."""


class PolicyReuse(Advice):
    """A step takes the source's action with probability psi = psi_start nu^episode, else that of DQN."""

    settings: Any
    source: Network
    _exploration: np.random.Generator

    def __init__(
        self, settings: DQN, source: Network | None = None, delta: Network | None = None, source_steps: int = 0
    ) -> None:
        super().__init__(settings, source, delta, source_steps)
        self.episode(0)

    def begin(self, run: Run) -> None:
        """Use the random stream of the run's exploration."""
        self._exploration = run.exploration

    def episode(self, number: int) -> None:
        """Set psi, which takes the place of kappa."""
        psi = self.settings.psi_start * self.settings.nu**number
        self.kappa = psi if psi >= NEGLIGIBLE else 0.0

    def guided(self, observation: F32) -> int | None:
        """Return the source's action with probability psi."""
        if self._exploration.random() >= self.kappa:
            return None
        return int(self.source.row(observation).argmax())

    def statistics(self, observations: F32) -> dict[str, float]:
        """Return psi of the last episode."""
        return {"psi": self.kappa}

    def state(self) -> dict[str, Any]:
        """Return psi of the last episode."""
        return {"psi": self.kappa}

    def restore(self, state: Any) -> None:
        """Go back to what `state` returned."""
        self.kappa = float(state["psi"])
