"""Wherever a configuration's figures are shown, what was confirmed on unseen seeds has those, marked as such."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import yaml
from conftest import LOCAL, SPACE
from rich.console import Console

from dashboards.labels import minus
from dashboards.report.sections import figures, sections, winners
from dashboards.report.tables import Table
from orchestrator.analysis.comparison import compare
from orchestrator.analysis.findings import Findings, find
from orchestrator.analysis.groups import Group
from orchestrator.analysis.metrics import METRICS
from orchestrator.analysis.tables.summary_table import text_table
from orchestrator.execution.sweep import run
from orchestrator.export.formats import write
from orchestrator.export.largest_effect import largest_effect
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.mlflow.description import markdown
from orchestrator.tracking.mlflow.fields import group_figures, sweep_metrics
from orchestrator.tracking.mlflow.views import VIEWS
from search_spaces.loading import parse
from tests.deltatune.cli.in_process import command

AUC = next(metric for metric in METRICS if metric.key == "auc")
WITHOUT_FIGURES = {"sb3"}
"""Formats with hyperparameters alone."""


@pytest.fixture(scope="module")
def storage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sweeps that confirm what they select, and one that does not."""
    folder = tmp_path_factory.mktemp("confirmed_figures")
    for name, changes in {
        "one": {},
        "two": {"hyperparameters": {"episodes": [20]}},
        "plain": {"confirm": None},
    }.items():
        small: dict[str, Any] = {"confirm": {"seeds": 3}, "hyperparameters": {"episodes": [30]}}
        results = Results.create(folder, name, parse("small", SPACE | small | changes))
        assert run(results, LOCAL, Console(quiet=True)).failed == 0
    return folder


@functools.cache
def of(storage: Path, name: str) -> Findings:
    return find(Results.open(storage, name))


def exported(findings: Findings, folder: Path, form: str) -> Path:
    return write(findings, form, folder / f"out.{form}").files[0]


def from_entries(entry: dict[str, Any]) -> float:
    return float(entry["confirmed"]["auc"]["value"])


def from_best(entries: list[dict[str, Any]]) -> Callable[[Group], float]:
    found = {(each["task"], each["agent"], each["source"]): from_entries(each) for each in entries}
    return lambda group: found[group.task, group.agent, group.source]


def from_numbers(table: pd.DataFrame) -> Callable[[Group], float]:
    found = table.dropna(subset=["confirmed_auc"])

    def figure(group: Group) -> float:
        here = found[
            (found["task"] == group.task) & (found["agent"] == group.agent) & (found["source"] == group.source)
        ]
        return float(here["confirmed_auc"].item())

    return figure


def latex_rows(text: str) -> Callable[[Group], float]:
    """The rows that are marked, in the order of the best configurations."""
    assert "had no part in selecting the configuration" in text
    marked = [line for line in text.splitlines() if r"& 3$^{\dagger}$ &" in line]

    def figure(group: Group) -> float:
        assert group.confirmed is not None
        line = next(line for line in marked if f"{AUC.text(group.confirmed.auc).split()[0]}$ (" in line)
        return float(re.findall(r"& \$(-?[\d.]+)\$ \(", line)[0])

    return figure


READ: dict[str, Callable[[Path], Callable[[Group], float]]] = {
    "yaml": lambda path: from_best(yaml.safe_load(path.read_text())["best"]),
    "json": lambda path: from_best(json.loads(path.read_text())["best"]),
    "csv": lambda path: from_numbers(pd.read_csv(path)),
    "parquet": lambda path: from_numbers(pd.read_parquet(path)),
    "latex": lambda path: latex_rows(path.read_text()),
}


@pytest.mark.parametrize("form", sorted(READ))
def test_an_export_has_the_confirmed_figure(storage: Path, tmp_path: Path, form: str) -> None:
    findings = of(storage, "one")
    figure = READ[form](exported(findings, tmp_path, form))
    for group in (group for group in findings.best if group.stage == "transfer"):
        assert group.confirmed is not None
        assert group.confirmed.auc is not None
        assert figure(group) == pytest.approx(group.confirmed.auc.value, abs=0.005)


def test_every_format_is_in_that_test() -> None:
    from orchestrator.export.formats import FORMATS

    assert set(FORMATS) == set(READ) | WITHOUT_FIGURES


def test_latex_of_what_was_not_confirmed_has_no_mark(storage: Path, tmp_path: Path) -> None:
    text = exported(of(storage, "plain"), tmp_path, "latex").read_text()
    assert "dagger" not in text
    assert "too favourable until confirmed" in text


def test_tables_and_mlflow_have_the_confirmed_figure(storage: Path) -> None:
    findings = of(storage, "one")
    texts = text_table(findings.best)
    shown = next(one for one in sections(findings, figures(findings))[0] if one.id == "results").content[0]
    assert isinstance(shown, Table)
    report = {datum.text for row in shown.rows for datum in row}
    said = markdown(findings.results, findings.groups, findings.best)
    transfers = [group for group in findings.best if group.stage == "transfer"]
    for group in transfers:
        assert group.confirmed is not None
        text = AUC.text(group.confirmed.auc)
        assert text in set(texts["confirmed AUC mean (sd)"])
        assert minus(text) in report
        assert text in said
        assert group_figures(group)[1]["confirmed AUC"] == text
    assert "|3 unseen|" in said
    for view in VIEWS[:2]:
        assert {"confirmed AUC", "confirmed verdict"} <= set(view.tags)
        assert "tags.stage = 'transfer'" in view.condition
    for winner in winners(findings):
        here = [group.judged.auc for group in findings.best if group.task == winner.task]
        assert winner.judged.auc is not None
        assert winner.judged.auc.value == max(auc.value for auc in here if auc is not None)
        best = [value for name, value in sweep_metrics(findings.best).items() if name.startswith("best_auc")]
        assert any(value == pytest.approx(winner.judged.auc.value, rel=1e-5) for value in best)


def test_the_largest_effect_is_that_of_the_unseen_seeds(storage: Path, tmp_path: Path) -> None:
    path = exported(of(storage, "one"), tmp_path, "yaml")
    found = largest_effect(path)
    ratios = [each["confirmed"].get("transfer_ratio") for each in yaml.safe_load(path.read_text())["best"]]
    assert found is None or {key: found[key] for key in ("value", "low", "high")} in ratios


def test_two_sweeps_are_compared_on_unseen_seeds_where_both_have_them(storage: Path) -> None:
    one, two, plain = (of(storage, name) for name in ("one", "two", "plain"))
    for row in compare(one, two).rows:
        group = next(g for g in one.best if (g.task, g.agent, g.source_label) == (row.task, row.agent, row.source))
        assert row.confirmed == (group.confirmed is not None)
        assert group.judged.auc is not None
        assert row.first == pytest.approx(group.judged.auc.value)
        assert row.seeds == len(group.judged.seeds)
    mixed = compare(one, plain)
    assert not any(row.confirmed for row in mixed.rows)
    assert all(row.verdict == "the same" for row in mixed.rows)
    assert mixed.note is not None
    said = command("compare", "one", "two", "--storage", str(storage))[1]
    assert "* on seeds that had no part in selecting the configuration" in said
    said = command("compare", "one", "plain", "--storage", str(storage))[1]
    assert "*" not in said
    assert "too favourable until confirmed" in " ".join(said.split())
