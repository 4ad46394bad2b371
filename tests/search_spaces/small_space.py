"""A search space as a user would write it, to be changed by one thing at a time."""

from __future__ import annotations

import copy
from typing import Any

SMALL: dict[str, Any] = {
    "schema": 1,
    "name": "small",
    "seeds": 2,
    "scenarios": [
        {
            "source": {"task": "windy_gridworld", "hyperparameters": {"learning_rate": [0.5, 0.1]}},
            "targets": ["windy_gridworld:wind=small", "windy_gridworld:wind=reversed"],
        }
    ],
    "agents": {"q_learning": {}, "ppr": {"nu": [0.9, 0.8]}, "delta_gate": {"threshold": 3}},
}


def changed(path: str, value: object) -> dict[str, Any]:
    """SMALL with `value` at a dotted path; numbers are positions in lists."""
    data: Any = copy.deepcopy(SMALL)
    at, keys = data, path.split(".")
    for key in keys[:-1]:
        at = at[int(key)] if isinstance(at, list) else at.setdefault(key, {})
    at[int(keys[-1]) if isinstance(at, list) else keys[-1]] = value
    result: dict[str, Any] = data
    return result
