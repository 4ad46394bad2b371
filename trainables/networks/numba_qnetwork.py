"""The Q-network of the deep agents: compiled kernels on memory that is shared with a torch module."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from trainables.networks import distillation, mlp
from trainables.networks.workspace import Workspace, aligned, parameter_count, workspace
from trainables.numerics.matmul import F32


class QNetwork:
    """A ReLU multilayer perceptron with one output per action, and its Adam optimiser.

    parameters: flat float32, in the order of `as_module().parameters()`, which share its memory.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        batch_size: int,
        learning_rate: float,
        *,
        max_gradient_norm: float = 10.0,
        huber: bool = False,
        generator: torch.Generator | None = None,
        shares_with: QNetwork | None = None,
    ) -> None:
        """sizes: inputs, hidden layers, actions. generator: draws the Xavier weights; without one they are 0.

        shares_with: a network in the same thread whose workspace this one shares if the sizes are equal; two networks
        that are trained in turn then use less of the processor's cache.
        """
        self.sizes = np.array(sizes, dtype=np.int64)
        self.parameters = aligned(parameter_count(self.sizes))
        self.first, self.second = (aligned(len(self.parameters)) for _ in range(2))
        self.updates = 0
        self._settings = learning_rate, max_gradient_norm, huber
        self._work: Workspace
        if shares_with is not None and np.array_equal(shares_with.sizes, self.sizes):
            self._work = shares_with._work
        else:
            self._work = workspace(self.sizes, max(batch_size, 64))
        self._trained = self.sizes, self.parameters, self.first, self.second, self._work
        self._read = self.sizes, self.parameters, self._work
        self._row = aligned(int(self.sizes[1:].sum()))
        if generator is not None:
            self._initialise(generator)

    def _initialise(self, generator: torch.Generator) -> None:
        """Draw Xavier (Glorot) uniform weights; the biases stay 0."""
        for weight in (w for w in self.as_module().parameters() if w.ndim == 2):
            nn.init.xavier_uniform_(weight, generator=generator)

    def update(self, observations: F32, actions: NDArray[np.int64], targets: F32) -> float:
        """Take an Adam step on the mean squared (or Huber) error of Q(s,a) to the targets (B,); return the loss before.

        observations: (obs_dim, B), flat: the batch is last. actions: (B,).
        """
        self.updates += 1
        return mlp.update(*self._trained, observations, actions, targets, self.updates, *self._settings)

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

        teacher: (B, actions). The divergence is a mean over the batch.
        """
        self.updates += 1
        return distillation.update(
            *self._trained, observations, actions, targets, teacher, weight, temperature, self.updates, *self._settings
        )

    def row(self, observation: F32) -> F32:
        """Return Q(s, .) (actions,) at one observation (obs_dim,). The next call overwrites it."""
        at = mlp.single(self.sizes, self.parameters, observation, self._row)
        return self._row[at : at + int(self.sizes[-1])]

    def rows(self, observations: F32) -> F32:
        """Return Q(s, .) (n, actions) at observations (n, obs_dim)."""
        out = np.empty((len(observations), int(self.sizes[-1])), np.float32)
        mlp.outputs(*self._read, np.ascontiguousarray(observations), out)
        return out

    @property
    def trained(self) -> tuple[tuple[Any, ...], tuple[float, float, bool]]:
        """Return the arguments of `mlp.update` before and after the minibatch and its number."""
        return self._trained, self._settings

    @property
    def read(self) -> tuple[tuple[Any, ...], F32]:
        """Return the first arguments of `mlp.outputs`, and the buffer of `mlp.single`."""
        return self._read, self._row

    def vector(self) -> F32:
        """Return a copy of the parameters, flat."""
        return self.parameters.copy()

    def load_vector(self, vector: F32) -> None:
        """Set the parameters to a flat vector; the optimiser stays as it is."""
        self.parameters[:] = vector

    def as_module(self) -> nn.Sequential:
        """Return the network as a torch module on the same memory; a step of either changes both."""
        layers: list[nn.Module] = []
        flat, at = torch.from_numpy(self.parameters), 0
        for n_in, n_out in zip(self.sizes[:-1].tolist(), self.sizes[1:].tolist(), strict=True):
            linear = nn.Linear(n_in, n_out, device="meta")
            linear.weight = nn.Parameter(flat[at : at + n_in * n_out].view(n_out, n_in))
            at += n_in * n_out
            linear.bias = nn.Parameter(flat[at : at + n_out])
            at += n_out
            layers += [linear, nn.ReLU()]
        return nn.Sequential(*layers[:-1])

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Return a copy of the parameters under the names of `as_module()`."""
        return {name: tensor.clone() for name, tensor in self.as_module().state_dict().items()}

    def load_state_dict(self, state: Mapping[str, torch.Tensor]) -> None:
        """Set the parameters. Raises torch's error where names or shapes do not fit."""
        self.as_module().load_state_dict(dict(state))

    def state(self) -> dict[str, Any]:
        """Return parameters and optimiser, for a checkpoint."""
        return {
            "parameters": self.parameters.copy(),
            "first": self.first.copy(),
            "second": self.second.copy(),
            "updates": self.updates,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned."""
        for name in ("parameters", "first", "second"):
            getattr(self, name)[:] = state[name]
        self.updates = int(state["updates"])
