"""The greedy policy of a registered source. MLflow stores this file with the arrays and runs it to load the model.

It is self-contained: loading the model needs numpy and MLflow but not deltatune, and unpickles nothing.
"""

from __future__ import annotations

import itertools
from typing import Any

import mlflow
import numpy as np
from mlflow.pyfunc.model import PythonModel

Array = np.ndarray[Any, Any]


class GreedyPolicy(PythonModel):
    """argmax_a Q(s, a), the lowest action on ties; actions are numbered from 0."""

    def load_context(self, context: Any) -> None:
        """Load the arrays of the source."""
        with np.load(context.artifacts["knowledge"], allow_pickle=False) as file:
            self._arrays = {name: file[name] for name in file.files if name != "meta"}

    def predict(self, context: Any, model_input: np.ndarray, params: Any = None) -> Array:
        """Return actions (B,) int64 for observations (B, obs_dim) of a deep source, or states (B,) of a tabular one.

        Raises ValueError for a state that the table does not have, and for observations of another length.
        """
        if "q" in self._arrays:
            values = _rows(self._arrays["q"], np.asarray(model_input))
        else:
            observations = np.asarray(model_input, dtype=np.float32)
            values = q_values(self._arrays["sizes"].tolist(), self._arrays["best"], observations)
        actions: Array = values.argmax(axis=1)
        return actions


def _rows(q: Array, states: Array) -> Array:
    """Return Q(s, .) (B, A) for states (B,)."""
    if len(states) and not 0 <= states.min() <= states.max() < len(q):
        raise ValueError(f"a state must be 0 to {len(q) - 1} (got {states.min()} to {states.max()})")
    rows: Array = q[states]
    return rows


def q_values(sizes: list[int], parameters: Array, observations: Array) -> Array:
    """Return Q(s, .) (B, actions) float32 of a ReLU perceptron, for observations (B, inputs) float32.

    parameters: flat float32, weights (n_out, n_in) and biases of each layer in turn. Products are summed in the order
    of the inputs and rounded to 32 bits after each, as by the fused multiply-add with which the agent was trained; a
    BLAS library sums in another order, and would occasionally choose another action.
    """
    if observations.ndim != 2 or observations.shape[1] != sizes[0]:
        raise ValueError(f"observations must be (B, {sizes[0]}) (got {observations.shape})")
    values, at, layers = observations, 0, len(sizes) - 1
    for layer, (n_in, n_out) in enumerate(itertools.pairwise(sizes)):
        weights = parameters[at : at + n_in * n_out].reshape(n_out, n_in).astype(np.float64)
        at += n_in * n_out
        inputs, total = values.astype(np.float64), np.zeros((len(values), n_out), np.float32)
        for k in range(n_in):
            total = (inputs[:, k, None] * weights[:, k] + total).astype(np.float32)
        values = total + parameters[at : at + n_out]
        at += n_out
        if layer < layers - 1:
            values = np.maximum(values, np.float32(0))
    return values


mlflow.models.set_model(GreedyPolicy())
