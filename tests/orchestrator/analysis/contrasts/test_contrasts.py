"""Two agents of a sweep against each other: the numbers by hand, the pairing, and the correction for how many."""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from orchestrator.analysis.contrasts.contrast import Contrast, contrasts
from orchestrator.analysis.contrasts.table import COLUMNS, number_table, numbers, p_text, row
from orchestrator.analysis.findings import Findings, find
from orchestrator.analysis.inference.multiplicity import holm, simultaneous
from orchestrator.analysis.statistics import difference
from orchestrator.export.best_params import best
from orchestrator.planning.arms import Label
from orchestrator.results.sweep_folder import Results
from orchestrator.results.tables.cell_row import cell_row
from orchestrator.tracking.mlflow.fields import group_figures
from search_spaces.loading import parse
from trainables.cell import Cell, Source
from trainables.errors import InputError
from trainables.tasks.registry import parse_task

X5, X7 = (parse_task(f"cartpole:gravity={times}x").name for times in (5, 7))
SPACE = {
    "schema": 1,
    "name": "deep",
    "seeds": 5,
    "scenarios": [{"source": {"task": "cartpole", "agent": "dqn"}, "targets": [X5, X7]}],
    "agents": {"dqn": {}, "es": {}, "delta_es": {}},
}
AUCS: dict[tuple[str, str], list[float]] = {
    ("dqn", X5): [139.4, 131.2, 128.9, 144.0, 125.1],
    ("es", X5): [157.0, 149.1, 151.3, 166.2, 142.0],
    ("delta_es", X5): [163.8, 151.0, 158.8, 163.0, 149.4],
    ("dqn", X7): [131.8, 120.9, 142.7, 128.0, 126.3],
    ("es", X7): [127.6, 113.4, 141.8, 124.2, 136.0],
    ("delta_es", X7): [158.6, 141.0, 149.7, 151.1, 146.9],
}


def made(folder: Path, aucs: Mapping[tuple[str, str], Sequence[float]] = AUCS, **options: Any) -> Findings:
    """The findings of a sweep with these AUCs by agent and target, a number per seed, of one source model."""
    rows = []
    for (agent, task), values in aucs.items():
        source = None if agent == "dqn" else Source(task="cartpole", kind="learned", cell_id="a" * 16)
        for seed, auc in enumerate(values):
            cell = Cell.create(agent, task, seed, options, source)
            label = Label("best_evaluated" if source else "")
            figures = dict.fromkeys(("auc", "training_auc", "initial_return", "final_return", "asymptotic"), auc)
            rows.append(cell_row("transfer", cell, None, label) | {"status": "done"} | figures)
    results = Results.create(folder, "deep", parse("deep", SPACE))
    return find(results, (pd.DataFrame(rows), pd.DataFrame({"cell_id": [], "episode": [], "greedy_return": []})))


def by_name(found: Sequence[Contrast]) -> dict[tuple[str, str], Contrast]:
    return {(contrast.name, contrast.first.task): contrast for contrast in found}


def test_the_family_of_a_sweep_begins_with_delta_es_minus_es(tmp_path: Path) -> None:
    found = made(tmp_path).contrasts
    assert [(contrast.name, contrast.first.task) for contrast in found] == [
        ("delta_es - es", X5),
        ("delta_es - es", X7),
        ("es - dqn", X5),
        ("es - dqn", X7),
        ("delta_es - dqn", X5),
        ("delta_es - dqn", X7),
    ]


def test_each_number_is_that_of_scipys_paired_test(tmp_path: Path) -> None:
    found = made(tmp_path).contrasts
    for contrast in found:
        a, b = (AUCS[group.agent, contrast.first.task] for group in (contrast.first, contrast.second))
        test = stats.ttest_rel(a, b)
        interval = test.confidence_interval(0.95)
        wide = test.confidence_interval(1 - 0.05 / 6)
        assert contrast.corrected is not None
        mine = [contrast.difference.value, contrast.difference.p, contrast.difference.low, contrast.difference.high]
        mine += [contrast.corrected.low, contrast.corrected.high]
        theirs = [np.mean(np.subtract(a, b)), test.pvalue, interval.low, interval.high, wide.low, wide.high]
        assert mine == pytest.approx(theirs, rel=1e-12, abs=1e-12)
        assert contrast.corrected.comparisons == 6
    by_hand = holm_by_its_definition([contrast.difference.p or 0 for contrast in found])
    assert [contrast.corrected.p for contrast in found if contrast.corrected] == pytest.approx(by_hand, rel=1e-12)


def holm_by_its_definition(p: Sequence[float]) -> list[float]:
    """Return max over the j up to its rank of (m - j + 1) p_(j), at most 1."""
    order = sorted(p)
    return [
        min(1.0, max((len(p) - j) * order[j] for j in range(order.index(value) + 1))) if value else 0.0 for value in p
    ]


def test_holms_published_example_and_its_order() -> None:
    # Holm's correction of these four in R's p.adjust
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02], rel=1e-12)
    assert holm([]) == []
    assert holm([0.9, 0.8]) == [1.0, 1.0]
    for bad in ([1.2], [float("nan")], [-0.1]):
        with pytest.raises(ValueError, match="between 0 and 1"):
            holm(bad)


def test_the_correction_keeps_the_family_wise_error() -> None:
    rng = np.random.default_rng(0)
    plain = corrected = outside = 0
    for _ in range(400):
        tests = [difference(rng.normal(size=5), rng.normal(size=5)) for _ in range(14)]
        p = [test.p or 0.0 for test in tests]
        plain += min(p) <= 0.05
        corrected += min(holm(p)) <= 0.05
        ends = [simultaneous(test, 14) or (0.0, 0.0) for test in tests]
        outside += any(low > 0 or high < 0 for low, high in ends)
    assert plain / 400 > 0.4
    assert corrected / 400 < 0.08
    assert outside / 400 < 0.08


def test_a_verdict_says_whether_it_holds_after_the_correction(tmp_path: Path) -> None:
    findings = made(tmp_path)
    texts = {(group.agent, group.task): group.verdict_text for group in findings.best}
    assert texts == {
        ("dqn", X5): None,
        ("dqn", X7): None,
        ("es", X5): "helped",
        ("es", X7): "undecided",
        ("delta_es", X5): "helped",
        ("delta_es", X7): "helped",
    }
    close = AUCS | {("es", X7): [135.8, 121.4, 149.8, 130.2, 132.0]}
    found = made(tmp_path / "close", close)
    group = next(group for group in found.best if (group.agent, group.task) == ("es", X7))
    assert group.verdict == "helped"
    assert group.verdict_text == "helped (Holm: undecided)"
    assert group.corrected is not None
    assert group.corrected.p > 0.05 >= (group.against_base.difference.p if group.against_base else 1)
    contrast = by_name(found.contrasts)["es - dqn", X7]
    assert contrast.verdict_text == "better (Holm: undecided)"
    assert group_figures(group)[1]["verdict"] == "helped"
    assert group_figures(group)[1]["holds"] == "false"
    assert group_figures(group)[0]["difference_p_holm"] == group.corrected.p


def test_any_pair_is_there_on_request_and_corrected_for_itself(tmp_path: Path) -> None:
    findings = made(tmp_path)
    found = findings.contrast("es", "delta_es")
    assert [contrast.name for contrast in found] == ["es - delta_es"] * 2
    family = by_name(findings.contrasts)
    for contrast in found:
        assert contrast.corrected is not None
        assert contrast.corrected.comparisons == 2
        assert contrast.difference.value == -family["delta_es - es", contrast.first.task].difference.value
    assert len(findings.contrast(every=True)) == 6
    assert findings.contrast() == findings.contrasts


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("es", "ess"), "unknown agent of deep.*'ess'.*did you mean 'es'"),
        (("es",), "two agents.*es alone"),
        (("es", "es"), "differ.*es twice"),
    ],
)
def test_a_wrong_pair_is_one_sentence(tmp_path: Path, words: tuple[str, ...], says: str) -> None:
    with pytest.raises(InputError, match=says):
        made(tmp_path).contrast(*words)


def test_one_seed_has_a_difference_and_no_test(tmp_path: Path) -> None:
    found = made(tmp_path, {key: values[:1] for key, values in AUCS.items()}).contrasts
    assert {(contrast.verdict, contrast.corrected, contrast.difference.p) for contrast in found} == {
        ("undecided", None, None)
    }
    assert row(found[0])[COLUMNS.index("p (Holm)")] == "-"


def test_seeds_that_only_one_has_are_left_out(tmp_path: Path) -> None:
    findings = made(tmp_path, AUCS | {("es", X5): AUCS["es", X5][:3]})
    contrast = by_name(findings.contrasts)["delta_es - es", X5]
    gaps = np.subtract(AUCS["delta_es", X5][:3], AUCS["es", X5][:3])
    assert (contrast.seeds, contrast.difference.value) == (3, pytest.approx(gaps.mean()))


def test_the_best_configurations_are_contrasted_with_the_same_source(tmp_path: Path) -> None:
    rows = []
    for agent, cell_id, shift in itertools.product(("es", "delta_es"), "ab", (0.0, 1.0)):
        source = Source(task="cartpole" if cell_id == "a" else X7, kind="learned", cell_id=cell_id * 16)
        for seed in range(3):
            cell = Cell.create(agent, X5, seed, {"learning_rate": 1e-3 + shift * 1e-3}, source)
            auc = 100 + seed**2 + 10 * shift + (5 if cell_id == "a" else 7) * (agent == "delta_es") * (seed + 1)
            figures = dict.fromkeys(("auc", "training_auc", "initial_return", "final_return", "asymptotic"), auc)
            rows.append(cell_row("transfer", cell, None, Label("best_evaluated")) | {"status": "done"} | figures)
    results = Results.create(tmp_path, "deep", parse("deep", SPACE))
    found = find(results, (pd.DataFrame(rows), pd.DataFrame({"cell_id": []}))).contrasts
    assert [(each.first.source_task, each.second.source_task) for each in found] == [
        ("cartpole", "cartpole"),
        (X7, X7),
    ]
    assert [each.difference.value for each in found] == [10.0, 14.0]
    assert {each.second.hyperparameters["learning_rate"] for each in found} == {2e-3}


def test_exports_have_every_number(tmp_path: Path) -> None:
    findings = made(tmp_path)
    table = number_table(findings.contrasts)
    assert len(table) == 6
    assert list(table["p_holm"]) == [contrast.corrected.p for contrast in findings.contrasts if contrast.corrected]
    assert best(findings)["contrasts"] == [numbers(contrast) for contrast in findings.contrasts]
    json.dumps(best(findings), allow_nan=False)
    assert number_table([]).empty


def test_no_configuration_has_no_contrast() -> None:
    assert contrasts([], [], pd.DataFrame()) == []


def test_small_p_values_keep_their_size() -> None:
    assert [p_text(p) for p in (None, 0.00001, 0.0312, 0.5)] == ["-", "<0.0001", "0.0312", "0.50"]
