"""The greedy policy of a registered source: the file that MLflow keeps beside the arrays and runs when it loads them.

It stands alone: whoever loads the model needs numpy and MLflow, not this package, and nothing is unpickled.
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
        """Read the arrays of the source."""
        with np.load(context.artifacts["knowledge"], allow_pickle=False) as file:
            self._arrays = {name: file[name] for name in file.files if name != "meta"}

    def predict(self, context: Any, model_input: np.ndarray, params: Any = None) -> Array:
        """Actions (B,) int64, for observations (B, obs_dim) of a deep source, or states (B,) of a tabular one.

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
    """Q(s, .) (B, A) of the states (B,)."""
    if len(states) and not 0 <= states.min() <= states.max() < len(q):
        raise ValueError(f"a state must be 0 to {len(q) - 1} (got {states.min()} to {states.max()})")
    rows: Array = q[states]
    return rows


def q_values(sizes: list[int], parameters: Array, observations: Array) -> Array:
    """Q(s, .) (B, actions) float32 of a ReLU perceptron, at observations (B, inputs) float32.

    parameters: flat float32, weights (n_out, n_in) and biases of each layer in turn. Every product is summed in the
    order of its inputs and rounded to 32 bits after each of them, which is the fused multiply-add that the agent was
    trained with; a BLAS library sums in an order of its own, and would now and then take another action.
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
