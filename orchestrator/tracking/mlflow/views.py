"""Saved views that MLflow's runs page offers under "Views": filter, order and columns of a table.

MLflow stores a saved view as compressed JSON in a tag of the experiment; a version that does not know it ignores it.
"""

from __future__ import annotations

import base64
import json
import zlib
from dataclasses import dataclass

PREFIX = "mlflow.sharedViewState."

SECTION = "Evaluation curves"
"""The title above the charts of a view."""

CHART_PIXELS = 480
"""The height of a chart, which is as wide as its page."""

_PIXELS = {
    "AUC": 112,
    "transfer_ratio": 125,
    "verdict": 85,
    "task": 230,
    "source": 85,
    "difference": 150,
    "place": 70,
    "holds": 60,
    "confirmed AUC": 125,
    "confirmed verdict": 130,
}

PINNED = {"attributes.`Run Name`": 132, "runDateAndNestInfo": 44}
"""The columns that every table begins with, and their widths: a run's name, and its status without its date."""

WIDTHS = {f"tags.`{name}`": width for name, width in (_PIXELS | {"agent": 130}).items()}
WIDTHS |= {"metrics.`auc`": 95} | PINNED
"""Widths of columns in pixels, so that a window of 1000 shows AUC and transfer ratio beside MLflow's assistant, which
is open when a browser comes for the first time."""


CURVES = ("greedy_return_mean", "greedy_return_low", "greedy_return_high")
"""The evaluation curve of an aggregate, and the ends of its 95 % interval."""


@dataclass(frozen=True)
class Chart:
    """A line chart over episodes that has several metrics of each run."""

    title: str
    metrics: tuple[str, ...]

    def card(self, section: str) -> dict[str, object]:
        """Return the chart as MLflow stores it, in a section."""
        return {
            "type": "LINE",
            "uuid": f"{section}-{self.metrics[0]}",
            "metricSectionId": section,
            "displayName": self.title,
            "metricKey": self.metrics[0],
            "selectedMetricKeys": list(self.metrics),
            "runsCountToCompare": 10,
            "deleted": False,
            "isGenerated": False,
            "lineSmoothness": 0,
            "xAxisKey": "step",
            "xAxisScaleType": "linear",
            "scaleType": "linear",
            "selectedXAxisMetricKey": "",
            "yAxisKey": "metric",
            "yAxisExpressions": [],
            "displayPoints": False,
            "range": {},
            "ignoreOutliers": False,
            "useGlobalXaxisKey": True,
            "useGlobalLineSmoothing": True,
        }


@dataclass(frozen=True)
class View:
    """One saved view."""

    key: str
    """Its name in a link: /#/experiments/ID/runs?viewStateShareKey=KEY."""
    name: str
    condition: str
    """MLflow's search expression."""
    order: str
    """The column by which it is sorted: metrics.`NAME` or tags.`NAME`."""
    ascending: bool
    tags: tuple[str, ...]
    metrics: tuple[str, ...]
    lead: tuple[str, ...] = ()
    """Metrics that come before the tags."""
    charts: tuple[Chart, ...] = ()
    """The first charts of the page's chart view."""

    def tag(self) -> tuple[str, str]:
        """Return (key, value) of the experiment's tag."""
        columns = [f"metrics.`{name}`" for name in self.lead] + [f"tags.`{name}`" for name in self.tags]
        columns += [f"metrics.`{name}`" for name in self.metrics]
        state: dict[str, object] = {
            "searchFilter": self.condition,
            "orderByKey": self.order,
            "orderByAsc": self.ascending,
            "startTime": "ALL",
            "lifecycleFilter": "Active",
            "selectedColumns": columns,
            "columnOrder": [*PINNED, *columns],
            "columnWidths": WIDTHS,
        }
        if self.charts:
            section = {"uuid": self.key, "name": SECTION, "display": True, "isReordered": False}
            state["compareRunSections"] = [section | {"columns": 1, "cardHeight": CHART_PIXELS}]
            state["compareRunCharts"] = [chart.card(self.key) for chart in self.charts]
        packed = base64.b64encode(zlib.compress(json.dumps(state).encode())).decode()
        value = {"name": self.name, "createdAt": 0, "updatedAt": 0, "state": f"deflate;{packed}"}
        return PREFIX + self.key, json.dumps(value)


CONFIRMED = ("confirmed AUC", "confirmed verdict")
"""The columns of what was confirmed on unseen seeds."""

LEADERBOARD = View(
    "deltatune-leaderboard",
    "Leaderboard",
    "tags.kind = 'aggregate' and tags.stage = 'transfer'",
    "tags.`place`",
    True,
    ("AUC", "transfer_ratio", "verdict", "task", "source", "difference", "holds", *CONFIRMED, "place"),
    (),
    charts=(Chart("Evaluation curve with its 95 % interval", CURVES),),
)
"""Grouped by task, the best AUC first, with the numbers as rounded text; as charts, the evaluation curves."""

VIEWS = (
    LEADERBOARD,
    View(
        "deltatune-negative-transfer",
        "Negative transfer",
        "tags.kind = 'aggregate' and tags.stage = 'transfer' and metrics.transfer_ratio_high < 0",
        "metrics.`transfer_ratio`",
        True,
        ("AUC", "transfer_ratio", "verdict", "source", "difference", "holds", *CONFIRMED),
        (),
    ),
    View(
        "deltatune-sources",
        "Source stage",
        "tags.kind = 'aggregate' and tags.stage = 'source'",
        "metrics.`auc`",
        False,
        ("AUC", "task", "agent"),
        ("seeds",),
    ),
    View(
        "deltatune-cells",
        "Cells of the transfer stage",
        "tags.kind = 'cell' and tags.stage = 'transfer'",
        "metrics.`auc`",
        False,
        ("task", "agent", "source", "seed", "status"),
        ("final_return", "max_abs_delta", "seconds"),
        lead=("auc",),
    ),
)
