"""Three views that MLflow's runs page offers under "Views": filter, order and columns of a table, ready to open.

The page keeps a saved view in a tag of the experiment, as compressed JSON; a UI that does not know it shows nothing.
"""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import dataclass

PREFIX = "mlflow.sharedViewState."


@dataclass(frozen=True)
class View:
    """One saved view."""

    key: str
    """Names it in a link: /#/experiments/ID/runs?viewStateShareKey=KEY."""
    name: str
    condition: str
    """MLflow's search expression."""
    order: str
    """The metric that it is sorted by."""
    ascending: bool
    tags: tuple[str, ...]
    metrics: tuple[str, ...]

    def tag(self) -> tuple[str, str]:
        """(key, value) of the experiment's tag."""
        columns = [f"tags.`{name}`" for name in self.tags] + [f"metrics.`{name}`" for name in self.metrics]
        state = {
            "searchFilter": self.condition,
            "orderByKey": f"metrics.`{self.order}`",
            "orderByAsc": self.ascending,
            "startTime": "ALL",
            "lifecycleFilter": "Active",
            "selectedColumns": columns,
            "columnOrder": columns,
            "columnWidths": {"tags.`task`": 230, "tags.`agent`": 130},
        }
        packed = base64.b64encode(zlib.compress(json.dumps(state).encode())).decode()
        value = {"name": self.name, "createdAt": 0, "updatedAt": 0, "state": f"deflate;{packed}"}
        return PREFIX + self.key, json.dumps(value)


_WHAT = ("task", "agent", "source", "sweep")
_RATIO = ("transfer_ratio", "transfer_ratio_low", "transfer_ratio_high")

VIEWS = (
    View(
        "deltatune-leaderboard",
        "Leaderboard",
        "tags.kind = 'aggregate'",
        "auc",
        False,
        _WHAT,
        ("auc", "auc_sd", *_RATIO, "seeds"),
    ),
    View(
        "deltatune-negative-transfer",
        "Negative transfer",
        "tags.kind = 'aggregate' and metrics.transfer_ratio_high < 0",
        "transfer_ratio",
        True,
        _WHAT,
        (*_RATIO, "auc", "seeds"),
    ),
    View(
        "deltatune-cells",
        "Cells of the transfer stage",
        "tags.kind = 'cell' and tags.stage = 'transfer'",
        "auc",
        False,
        (*_WHAT, "seed", "status"),
        ("auc", "final_return", "max_abs_delta", "seconds"),
    ),
)
