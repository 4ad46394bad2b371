"""The steps of the supply chain, and its exact model (paper, Appendix B; Gimelfarb, Sanner and Lee, 2019)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from trainables.numerics.jit import compiled
from trainables.tasks.spec.family import Context
from trainables.tasks.spec.tabular_model import Dynamics, TransitionModel

KIND = 1
LIMIT = 50
"""Storage limit of the factory and of the warehouse; a state is factory * (LIMIT + 1) + warehouse."""
LEVELS = 10
"""Ship 0..9 and produce 0..9; an action is LEVELS * ship + produce."""
PRICE, PRODUCTION_COST, STORAGE_COST, TRUCK_COST, TRUCK = 0.5, 0.1, 0.02, 0.1, 5
START = (10, 0)
TIME_LIMIT = 200


@compiled
def settle(state: int, action: int, sold: int) -> tuple[int, float]:
    """Return (next state, reward) if `sold` units leave the warehouse before the shipment arrives."""
    factory, warehouse = state // (LIMIT + 1), state % (LIMIT + 1)
    ship = min(action // LEVELS, factory, LIMIT - warehouse + sold)
    produce = min(action % LEVELS, LIMIT - factory + ship)
    trucks = (ship + TRUCK - 1) // TRUCK
    reward = PRICE * sold - PRODUCTION_COST * produce - STORAGE_COST * (factory + warehouse) - TRUCK_COST * trucks
    return (factory - ship + produce) * (LIMIT + 1) + warehouse - sold + ship, reward


@compiled
def step(state: int, action: int, parameters: NDArray[np.float64], rng: np.random.Generator) -> tuple[int, float, bool]:
    """Take a step; return (next state, reward, terminated). parameters: (1,), the mean demand; unmet demand is lost."""
    sold = min(rng.poisson(parameters[0]), state % (LIMIT + 1))
    next_state, reward = settle(state, action, sold)
    return next_state, reward, False


def dynamics(context: Context) -> Dynamics:
    """Return the sampled dynamics for this mean demand."""
    start = START[0] * (LIMIT + 1) + START[1]
    states = (LIMIT + 1) ** 2
    return Dynamics(KIND, np.array([context["demand_mean"]]), start, states, LEVELS**2, TIME_LIMIT)


@compiled
def _outcomes(
    sales: NDArray[np.float64],
    indptr: NDArray[np.int64],
    indices: NDArray[np.int32],
    probabilities: NDArray[np.float64],
    rewards: NDArray[np.float64],
) -> None:
    """Fill the rows of the model from `sales` (LIMIT + 1, LIMIT + 1), p(sold | warehouse stock)."""
    at = 0
    for state in range(rewards.shape[0]):
        warehouse = state % (LIMIT + 1)
        for action in range(rewards.shape[1]):
            expected = 0.0
            for sold in range(warehouse + 1):
                next_state, reward = settle(state, action, sold)
                indices[at] = next_state
                probabilities[at] = sales[warehouse, sold]
                expected += sales[warehouse, sold] * reward
                at += 1
            rewards[state, action] = expected
            indptr[state * rewards.shape[1] + action + 1] = at


def model(context: Context) -> TransitionModel:
    """Return the exact model: an outcome for each number of units sold (about 6.8 million, 80 MB)."""
    from scipy.stats import poisson  # takes half a second, which workers of other tasks need not wait for

    dyn = dynamics(context)
    stock = np.arange(LIMIT + 1)
    demand = poisson(context["demand_mean"])
    sales = np.where(stock[None, :] < stock[:, None], demand.pmf(stock)[None, :], 0.0)
    np.fill_diagonal(sales, demand.sf(stock - 1))
    rows = dyn.states * dyn.actions
    size = dyn.actions * (LIMIT + 1) * int((stock + 1).sum())
    indptr = np.zeros(rows + 1, dtype=np.int64)
    indices = np.empty(size, dtype=np.int32)
    probabilities = np.empty(size)
    rewards = np.empty((dyn.states, dyn.actions))
    _outcomes(sales, indptr, indices, probabilities, rewards)
    transitions = csr_array((probabilities, indices, indptr.astype(np.int32)), shape=(rows, dyn.states))
    return TransitionModel(transitions, rewards, dyn.start, TIME_LIMIT)
