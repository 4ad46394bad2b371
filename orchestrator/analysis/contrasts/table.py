"""Contrasts as a person reads them, and as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pandas as pd

from orchestrator.analysis.contrasts.contrast import Contrast
from orchestrator.analysis.labels import settings, settings_text
from orchestrator.analysis.metrics import DIFFERENCE
from orchestrator.analysis.metrics import EARLY_DIFFERENCE as EARLY
from orchestrator.analysis.statistics import LEVEL
from trainables.plugins.names import short

GAP = f"A - B [{LEVEL:.0%}]"
COLUMNS = ("task", "A", "B", "source", "seeds", GAP, "p", "p (Holm)", "verdict", f"early {GAP}")

NUMBERS = (
    "early_difference",
    "early_low",
    "early_high",
    "early_p",
    *("difference", "low", "high", "p", "df", "p_holm", "low_all", "high_all"),
)
"""The columns of `numbers` that hold floats."""

SMALLEST = 1e-4
"""A p-value below is shown as that."""


def p_text(p: float | None) -> str:
    """Return '0.0312', '<0.0001', or a dash where there is no test."""
    if p is None:
        return "-"
    return f"<{SMALLEST}" if p < SMALLEST else f"{p:.4f}" if p < 0.1 else f"{p:.2f}"


def row(contrast: Contrast) -> tuple[str, ...]:
    """Return a contrast's line under COLUMNS."""
    first, gap, corrected = contrast.first, contrast.difference, contrast.corrected
    models = f" x {first.sources} sources" if first.networks > 1 else ""
    return (
        short(first.task),
        short(first.agent),
        short(contrast.second.agent),
        first.source_label,
        f"{contrast.seeds}{models}",
        DIFFERENCE.text(gap),
        p_text(gap.p),
        p_text(corrected.p if corrected else None),
        contrast.verdict_text,
        EARLY.text(contrast.early),
    )


def numbers(contrast: Contrast) -> dict[str, Any]:
    """Return a contrast as numbers in full: each side's configuration, the difference, plain and corrected."""
    first, second, gap, corrected = contrast.first, contrast.second, contrast.difference, contrast.corrected
    early = contrast.early
    return {
        "task": first.task,
        "a": first.agent,
        "b": second.agent,
        "source": first.source,
        "source_task": first.source_task,
        "pick": first.pick or None,
        "a_settings": settings_text(settings(first)),
        "b_settings": settings_text(settings(second)),
        "a_group": first.id,
        "b_group": second.id,
        "seeds": contrast.seeds,
        "sources": first.sources if first.networks > 1 else 1,
        "measure": contrast.measure,
        "difference": gap.value,
        "low": gap.low,
        "high": gap.high,
        "p": gap.p,
        "df": gap.df,
        "p_holm": corrected.p if corrected else None,
        "low_all": corrected.low if corrected else None,
        "high_all": corrected.high if corrected else None,
        "early_difference": early.value if early else None,
        "early_low": early.low if early else None,
        "early_high": early.high if early else None,
        "early_p": early.p if early else None,
        "comparisons": corrected.comparisons if corrected else 0,
        "verdict": contrast.verdict,
        "holds": corrected.holds if corrected else None,
    }


def number_table(found: Sequence[Contrast]) -> pd.DataFrame:
    """Return a row per contrast, a column per number."""
    table = pd.DataFrame([numbers(contrast) for contrast in found])
    return table.astype(dict.fromkeys(NUMBERS, "float64")) if len(table) else table


def comparisons(found: Sequence[Contrast]) -> int:
    """Return for how many comparisons at once the p-values are corrected."""
    return next((contrast.corrected.comparisons for contrast in found if contrast.corrected), 0)


def caption(found: Sequence[Contrast]) -> str:
    """Return what the numbers are, and for how many comparisons they are corrected."""
    n = comparisons(found)
    what = "early AUC" if found and found[0].measure == "early_auc" else "AUC"
    text = f"Paired differences in {what}, A - B, with {LEVEL:.0%} intervals"
    return text + (f"; p (Holm) is corrected for all {n} comparisons" if n > 1 else "")
