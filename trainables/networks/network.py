"""The interface of networks for deep agents, and the choice of one for a cell."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from trainables.agents.builtin.dqn import DQN
from trainables.errors import InputError
from trainables.knowledge import Knowledge
from trainables.networks.numba_qnetwork import QNetwork
from trainables.numerics.matmul import F32


class Network(Protocol):
    """Q(s, .) with its optimiser; see `QNetwork` for the methods."""

    sizes: NDArray[np.int64]
    """Inputs, hidden layers, actions; empty for a custom module, whose shape is unknown."""

    def update(self, observations: F32, actions: NDArray[np.int64], targets: F32) -> float:
        """Take an Adam step to targets (B,) at observations (inputs, B), flat, and actions (B,); return the loss."""

    def distil(
        self,
        observations: F32,
        actions: NDArray[np.int64],
        targets: F32,
        teacher: F32,
        weight: float,
        temperature: float,
    ) -> float:
        """Do the same as `update` with weight KL(softmax(teacher / temperature), softmax(Q / temperature)) in the loss.

        teacher: (B, actions).
        """

    def row(self, observation: F32) -> F32:
        """Return Q(s, .) (actions,) at one observation (inputs,)."""

    def rows(self, observations: F32) -> F32:
        """Return Q(s, .) (n, actions) at observations (n, inputs)."""

    def vector(self) -> F32:
        """Return a copy of all parameters, flat."""

    def load_vector(self, vector: F32) -> None:
        """Set the parameters to a vector that `vector` returned."""

    def state(self) -> dict[str, Any]:
        """Return parameters and the optimiser's state, for a checkpoint."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned."""


def new_network(
    settings: DQN,
    inputs: int,
    actions: int,
    learning_rate: float,
    generator: torch.Generator | None = None,
    hidden: tuple[int, ...] | None = None,
    shares_with: Network | None = None,
) -> Network:
    """Return a network for these settings; `hidden` replaces their layers. shares_with: see `QNetwork`."""
    layers = (settings.hidden_size,) * settings.hidden_layers if hidden is None else hidden
    if settings.module or settings.device != "cpu":
        from trainables.networks.torch_qnetwork import TorchNetwork

        return TorchNetwork(settings, inputs, actions, learning_rate, generator, layers)
    return QNetwork(
        (inputs, *layers, actions),
        settings.batch_size,
        learning_rate,
        max_gradient_norm=settings.max_gradient_norm,
        huber=settings.loss == "huber",
        generator=generator,
        shares_with=shares_with if isinstance(shares_with, QNetwork) else None,
    )


def source_network(
    knowledge: Knowledge, checkpoint: str, settings: DQN, inputs: int, actions: int, shares_with: Network | None = None
) -> Network:
    """Return the source's network, its `checkpoint` 'last' or 'best'.

    Raises InputError where the knowledge is not a deep agent's, not finite, or of another shape than the task.
    """
    arrays = knowledge.arrays
    if "sizes" not in arrays or checkpoint not in arrays:
        raise InputError("the source is not the knowledge of a deep agent")
    sizes, vector = [int(size) for size in arrays["sizes"]], arrays[checkpoint]
    if sizes and (sizes[0], sizes[-1]) != (inputs, actions):
        raise InputError(
            f"the source's network has {sizes[0]} inputs and {sizes[-1]} actions, "
            f"but the target task has {inputs} and {actions}"
        )
    if bool(sizes) != (not settings.module):
        raise InputError("the source's network is of another kind than the agent's `module`")
    if not np.isfinite(vector).all():
        raise InputError("the source's network holds a NaN or an infinity")
    network = new_network(
        settings, inputs, actions, 1.0, hidden=tuple(sizes[1:-1]) if sizes else None, shares_with=shares_with
    )
    if len(vector) != len(network.vector()):
        raise InputError(f"the source's network has {len(vector)} parameters, but {len(network.vector())} are needed")
    network.load_vector(vector)
    return network
