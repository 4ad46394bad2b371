"""A Q-network computed by torch, for GPUs and custom modules."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from trainables.agents.builtin.dqn import DQN
from trainables.errors import InputError
from trainables.numerics.matmul import F32
from trainables.numerics.threads import one_thread


class TorchNetwork:
    """The methods of `QNetwork` for any torch module on any device."""

    def __init__(
        self,
        settings: DQN,
        inputs: int,
        actions: int,
        learning_rate: float,
        generator: torch.Generator | None,
        hidden: tuple[int, ...] = (),
    ) -> None:
        """hidden: units of each hidden layer of the built-in perceptron, where the settings name no module.

        Raises InputError where there is no GPU or no such module factory, or the module's output does not fit.
        """
        one_thread()  # here too, since torch's sums depend on the number of threads
        if settings.device == "cuda" and not torch.cuda.is_available():
            raise InputError("device 'cuda' was requested, but torch finds no GPU")
        self._device = torch.device(settings.device)
        sizes = () if settings.module else (inputs, *hidden, actions)
        self.sizes = np.array(sizes, dtype=np.int64)
        module = _custom(settings.module, inputs, actions, generator) if settings.module else _perceptron(sizes)
        if generator is not None:
            _initialise(module, generator)
        self.module = module.to(self._device)
        self._optimiser = torch.optim.Adam(self.module.parameters(), learning_rate)
        self._max_norm = settings.max_gradient_norm
        self._loss = nn.functional.smooth_l1_loss if settings.loss == "huber" else nn.functional.mse_loss
        self._inputs = inputs
        if self.rows(np.zeros((2, inputs), np.float32)).shape != (2, actions):
            raise InputError(f"module '{settings.module}' must map (n, {inputs}) to (n, {actions})")

    def update(self, observations: F32, actions: NDArray[np.int64], targets: F32) -> float:
        """Take an Adam step on Q(s,a), and return the loss before it. observations: (inputs, B), flat."""
        return self._descend(self._td_loss(self._values(observations), actions, targets))

    def distil(
        self,
        observations: F32,
        actions: NDArray[np.int64],
        targets: F32,
        teacher: F32,
        weight: float,
        temperature: float,
    ) -> float:
        """Do the same as `update` with weight KL(softmax(teacher / temp.), softmax(Q / temp.)) in the loss."""
        values = self._values(observations)
        student = torch.log_softmax(values / temperature, dim=1)
        taught = torch.log_softmax(self._tensor(teacher) / temperature, dim=1)
        distance = nn.functional.kl_div(student, taught, reduction="batchmean", log_target=True)
        return self._descend(self._td_loss(values, actions, targets) + weight * distance)

    def _values(self, observations: F32) -> torch.Tensor:
        return cast("torch.Tensor", self.module(self._tensor(observations).view(self._inputs, -1).T))

    def _td_loss(self, values: torch.Tensor, actions: NDArray[np.int64], targets: F32) -> torch.Tensor:
        q = values.gather(1, self._tensor(actions)[:, None])[:, 0]
        return self._loss(q, self._tensor(targets))

    def _descend(self, loss: torch.Tensor) -> float:
        self._optimiser.zero_grad()
        torch.autograd.backward(loss)
        nn.utils.clip_grad_norm_(self.module.parameters(), self._max_norm)
        self._optimiser.step()
        return float(loss.detach())

    def row(self, observation: F32) -> F32:
        """Return Q(s, .) (actions,) at one observation (inputs,)."""
        first: F32 = self.rows(observation[None])[0]
        return first

    def rows(self, observations: F32) -> F32:
        """Return Q(s, .) (n, actions) at observations (n, inputs)."""
        with torch.no_grad():
            return cast("F32", self.module(self._tensor(observations)).cpu().numpy())

    def vector(self) -> F32:
        """Return a copy of the parameters, flat."""
        return cast("F32", nn.utils.parameters_to_vector(self.module.parameters()).detach().cpu().numpy().copy())

    def load_vector(self, vector: F32) -> None:
        """Set the parameters to a flat vector; the optimiser stays as it is."""
        with torch.no_grad():
            nn.utils.vector_to_parameters(self._tensor(vector), self.module.parameters())

    def state(self) -> dict[str, Any]:
        """Return parameters, buffers and optimiser, for a checkpoint."""
        slots = self._optimiser.state_dict()["state"]
        return {
            "module": {name: tensor.cpu().numpy().copy() for name, tensor in self.module.state_dict().items()},
            "optimiser": {
                str(index): {name: tensor.cpu().numpy().copy() for name, tensor in slot.items()}
                for index, slot in slots.items()
            },
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore what `state` returned."""
        self.module.load_state_dict({name: torch.from_numpy(array) for name, array in state["module"].items()})
        full = self._optimiser.state_dict()
        full["state"] = {
            int(index): {name: torch.from_numpy(np.array(array)) for name, array in slot.items()}
            for index, slot in state["optimiser"].items()
        }
        self._optimiser.load_state_dict(full)

    def _tensor(self, array: NDArray[Any]) -> torch.Tensor:
        return torch.from_numpy(array).to(self._device)


def _custom(name: str, inputs: int, actions: int, generator: torch.Generator | None) -> nn.Module:
    """Return the custom module. Its factory draws from the cell's stream, and torch's global stream stays unchanged."""
    factory = _factory(name)
    with torch.random.fork_rng(devices=[]):
        if generator is not None:
            torch.manual_seed(int(torch.randint(2**62, (1,), generator=generator)))
        return factory(inputs, actions)


def _perceptron(sizes: tuple[int, ...]) -> nn.Module:
    layers: list[nn.Module] = []
    for n_in, n_out in itertools.pairwise(sizes):
        layers += [nn.Linear(n_in, n_out), nn.ReLU()]
    return nn.Sequential(*layers[:-1])


def _factory(name: str) -> Callable[[int, int], nn.Module]:
    module, _, attribute = name.partition(":")
    try:
        return cast("Callable[[int, int], nn.Module]", getattr(import_module(module), attribute))
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(f"module '{name}' must be module:factory of a torch module ({error})") from None


def _initialise(module: nn.Module, generator: torch.Generator) -> None:
    """Set Xavier weights and zeros elsewhere, as in QNetwork; a module with other layers keeps its factory's values."""
    for layer in module.modules():
        if isinstance(layer, nn.Linear):
            nn.init.xavier_uniform_(layer.weight, generator=generator)
            if layer.bias is not None:
                nn.init.zeros_(layer.bias)
