"""The statistics of a configuration over its seeds, as data: how each is computed, written, and where it is shown.

Every view iterates over METRICS: the summary table, the report, LaTeX, best.yaml, MLflow and the tables of numbers. A
new statistic is one more entry here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, Protocol

from orchestrator.analysis import statistics
from orchestrator.analysis.curves import milestones
from orchestrator.analysis.inference.seeds import Seeds
from orchestrator.analysis.statistics import LEVEL, Estimate, TransferRatio

NOTHING = 1e-9
"""A difference up to this is shown as 0."""

View = Literal["summary", "report", "best"]
"""summary: the summary table; report: Table 1, in the report and as LaTeX; best: best.yaml.

MLflow and the tables of numbers have every metric.
"""


class HasEstimates(Protocol):
    """What has estimates by metric: a group."""

    @property
    def estimates(self) -> Mapping[str, Estimate | TransferRatio]:
        """Metric.key to its estimate."""


Compute = Callable[[Seeds], Estimate | TransferRatio | None]


@dataclass(frozen=True)
class Metric:
    """One statistic over seeds."""

    key: str
    """Its name in MLflow, best.yaml and the tables of numbers."""
    label: str
    compute: Compute
    shown: tuple[View, ...] = ()
    digits: int = 2
    percent: bool = False
    signed: bool = False
    """Whether it is written with its sign, as a difference is."""
    with_sd: bool = False
    """Whether its standard deviation over seeds is shown in place of its interval."""
    compared: bool = False
    """Whether it compares with the agent without transfer."""
    with_p: bool = False
    """Whether its p-value is among the numbers."""
    latex: str = ""
    """Its label in LaTeX; default: `label`."""

    @property
    def heading(self) -> str:
        """Its label, with the meaning of the brackets after the number."""
        return f"{self.label} mean (sd)" if self.with_sd else f"{self.label} [{LEVEL:.0%}]"

    def numbers(self, estimate: Estimate | TransferRatio | None) -> dict[str, float | None]:
        """Return an estimate as numbers named KEY, KEY_low, KEY_high, and KEY_sd and KEY_p where it has them."""
        ends = (None,) * 3 if estimate is None else (estimate.value, estimate.low, estimate.high)
        found = dict(zip((self.key, f"{self.key}_low", f"{self.key}_high"), ends, strict=True))
        if self.with_sd:
            found[f"{self.key}_sd"] = estimate.sd if isinstance(estimate, Estimate) else None
        if self.with_p:
            found[f"{self.key}_p"] = estimate.p if isinstance(estimate, Estimate) else None
        return found

    def text(self, estimate: Estimate | TransferRatio | None, missing: str = "-") -> str:
        """Return '-71.10 (1.64)', '+12% [+3, +21]', 'undefined', or `missing` for None."""
        return self.write(estimate, self._number, missing, "%" if self.percent else "")

    def write(
        self,
        estimate: Estimate | TransferRatio | None,
        number: Callable[[float, int], str],
        missing: str = "-",
        unit: str = "",
        least: str = "≥ ",
    ) -> str:
        """Return an estimate as text, each of its numbers formatted by `number`."""
        if estimate is None:
            return missing
        if estimate.value is None:
            return "undefined"
        scale = 100 if self.percent else 1
        text = number(scale * estimate.value, self.digits) + unit
        text = f"{least}{text}" if isinstance(estimate, Estimate) and estimate.at_least else text
        if isinstance(estimate, Estimate) and estimate.sd is not None:
            return f"{text} ({estimate.sd:.{self.digits}f})"
        if estimate.low is None or estimate.high is None:
            return text
        return f"{text} [{', '.join(number(scale * end, self.digits) for end in (estimate.low, estimate.high))}]"

    def _number(self, value: float, digits: int) -> str:
        return signed(value, digits) if self.signed else f"{value:.{digits}f}"


def signed(value: float, digits: int = 0) -> str:
    """Return a number with its sign; one that rounds to 0 gets one more digit, so that -0.4 is not printed as 0."""
    if round(value, digits) == 0 and abs(value) > NOTHING:
        digits += 1
    return f"{value if abs(value) > NOTHING else 0.0:+.{digits}f}"


def _mean(column: str) -> Compute:
    """Return the mean of a column of the cells table."""

    def compute(seeds: Seeds) -> Estimate | None:
        return seeds.mean(column)

    return compute


def _difference(column: str) -> Compute:
    """Return the paired difference of a column from the agent without transfer."""

    def compute(seeds: Seeds) -> Estimate | None:
        return seeds.difference(column)

    return compute


def _mean_with_sd(column: str) -> Compute:
    """Return the mean of a column of the cells table, with its standard deviation over cells."""

    def compute(seeds: Seeds) -> Estimate | None:
        values, estimate = seeds.values(column), seeds.mean(column)
        return replace(estimate, sd=statistics.sd(values)) if values and estimate else None

    return compute


def _episodes_to_solve(seeds: Seeds) -> Estimate | None:
    """Return the mean over seeds; an unsolved one counts as its whole run, and makes the mean a lower bound."""
    solved, estimate = seeds.values(milestones.SOLVED), seeds.mean(milestones.SOLVED_AFTER)
    bound = estimate is not None and solved is not None and not all(solved)
    return replace(estimate, low=None, high=None, at_least=True) if estimate and bound else estimate


def _share(column: str, part: Literal["sources", "seeds"]) -> Compute:
    """Return the share of the variance of a column that lies between source networks, or between seeds."""

    def compute(seeds: Seeds) -> Estimate | None:
        found = seeds.components(column)
        return None if found is None else getattr(found, part)

    return compute


def _iqm(seeds: Seeds) -> Estimate | None:
    values = seeds.values("auc")
    return statistics.iqm(values) if values else None


def _transfer_ratio(seeds: Seeds) -> TransferRatio | None:
    return seeds.ratio("auc")


def _improvement(seeds: Seeds) -> Estimate | None:
    if seeds.paired is None:
        return None
    both, n = (list(seeds.paired["auc"]), list(seeds.paired["auc_base"])), seeds.paired["seed"].nunique()
    return statistics.probability_of_improvement(*both, independent=(n, n))


TRANSFER_RATIO = Metric(
    "transfer_ratio",
    "transfer ratio",
    _transfer_ratio,
    ("summary", "report", "best"),
    digits=0,
    percent=True,
    signed=True,
    compared=True,
    latex=r"$tr$ (\%)",
)
DIFFERENCE = Metric(
    "difference",
    "difference",
    _difference("auc"),
    ("summary", "report", "best"),
    digits=1,
    signed=True,
    compared=True,
    with_p=True,
)
EARLY_DIFFERENCE = Metric(
    "early_difference",
    "early difference",
    _difference(milestones.EARLY),
    ("best",),
    digits=1,
    signed=True,
    compared=True,
    with_p=True,
)

_auc = _mean_with_sd("auc")

METRICS: tuple[Metric, ...] = (
    Metric("auc", "AUC", _auc, ("summary", "report", "best"), with_sd=True),
    Metric("early_auc", "early AUC", _mean_with_sd(milestones.EARLY), ("summary", "report", "best"), 1, with_sd=True),
    Metric("episodes_to_solve", "episodes to solve", _episodes_to_solve, ("summary", "report", "best"), digits=0),
    Metric("solved", "share of seeds that solved it", _mean(milestones.SOLVED)),
    Metric("variance_sources", "variance between sources", _share("auc", "sources"), digits=0, percent=True),
    Metric("variance_seeds", "variance between seeds", _share("auc", "seeds"), digits=0, percent=True),
    Metric(
        "early_variance_sources",
        "early variance between sources",
        _share(milestones.EARLY, "sources"),
        digits=0,
        percent=True,
    ),
    Metric("auc_iqm", "interquartile mean of the AUC", _iqm),
    Metric("training_auc", "AUC of the training returns", _mean("training_auc")),
    Metric("asymptotic", "asymptotic performance", _mean("asymptotic")),
    Metric("max_abs_delta", "max |delta| at the end of training", _mean("final_max_abs_delta")),
    Metric("advised_factor", "mean factor at the advised states", _mean("mean_advised_factor")),
    Metric("advised_delta", "mean max |delta| at the advised states", _mean("mean_advised_delta")),
    Metric("delta_median", "median of max |delta| over remembered states", _mean("final_delta_median")),
    Metric("delta_sample_median", "median size of delta's samples", _mean("final_delta_sample_median")),
    TRANSFER_RATIO,
    DIFFERENCE,
    Metric(
        "probability_of_improvement",
        "P(improvement)",
        _improvement,
        ("report",),
        compared=True,
        latex=r"$P(\mathrm{improvement})$",
    ),
    EARLY_DIFFERENCE,
    Metric("jumpstart", "jumpstart", _difference("initial_return"), signed=True, compared=True),
    Metric(
        "asymptotic_difference",
        "difference in asymptotic performance",
        _difference("asymptotic"),
        signed=True,
        compared=True,
    ),
)


def present(view: View, groups: Iterable[HasEstimates]) -> tuple[Metric, ...]:
    """Return the metrics of a view that at least one of several groups has."""
    there = {key for group in groups for key in group.estimates}
    return tuple(metric for metric in shown(view) if metric.key in there)


def shown(view: View) -> tuple[Metric, ...]:
    """Return the metrics of a view, in its order."""
    return tuple(metric for metric in METRICS if view in metric.shown)
