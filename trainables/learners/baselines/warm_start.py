"""A warm start: Q begins with the source's weights."""

from __future__ import annotations

from typing import Any

from trainables.errors import InputError
from trainables.learners.advice import Advice, Run
from trainables.networks.network import Network
from trainables.numerics.matmul import F32


class WarmStart(Advice):
    """No advice: Q and the target network begin with the weights of Q_src, with or without the last layer."""

    settings: Any
    source: Network

    def begin(self, run: Run) -> None:
        """Give Q the source's weights. Raises InputError where they do not fit the network of the settings."""
        vector, ours = weights(self.source, run), run.q.sizes.tolist()
        if self.settings.last_layer == "fresh":
            if not ours:
                raise InputError("last_layer 'fresh' is for the built-in perceptron, not for a custom module")
            fresh = (ours[-2] + 1) * ours[-1]
            vector[-fresh:] = run.q.vector()[-fresh:]
        for network in (run.q, run.target):
            network.load_vector(vector)


def weights(source: Network, run: Run) -> F32:
    """Return the source's weights, flat. Raises InputError where they do not fit the network of the settings."""
    theirs, ours = source.sizes.tolist(), run.q.sizes.tolist()
    if theirs != ours:
        raise InputError(
            f"{run.cell.agent} begins with the source's weights, whose hidden layers have {theirs[1:-1]} units, "
            f"but hidden_layers and hidden_size ask for {ours[1:-1]}"
        )
    return source.vector()
