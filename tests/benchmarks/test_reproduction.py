"""The page of the reproduction says what the published cells say."""

from __future__ import annotations

import json
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from benchmarks.reproduction import safe
from benchmarks.reproduction.__main__ import page
from benchmarks.reproduction.claims import CLAIMS, DELTA_ES, DQN, ES, LONG, X5, Arm, Claim, Comparison
from benchmarks.reproduction.curves import BASELINES, FRACTIONS, SAFE, Curves, difference, published
from benchmarks.reproduction.figures import draw
from benchmarks.reproduction.mean_gain import mean_gain
from benchmarks.reproduction.tables import ROWS, interval
from benchmarks.reproduction.verdicts import VERDICTS, findings, holm, spreads
from orchestrator.analysis.inference import crossed
from orchestrator.dataset.dataset import Dataset
from trainables.cell import Cell, Source
from trainables.tasks.registry import parse_task

PUBLISHED = Path(__file__).parents[2] / "docs" / "dataset"


def test_holm_is_the_textbook_example() -> None:
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])


@given(st.lists(st.floats(0, 1), min_size=1, max_size=20))
def test_holm_lies_between_the_plain_p_and_bonferronis(p_values: list[float]) -> None:
    for plain, corrected in zip(p_values, holm(p_values), strict=True):
        assert plain <= corrected <= min(1.0, plain * len(p_values)) + 1e-12
    order = np.argsort(p_values, kind="stable")
    assert (np.diff(np.asarray(holm(p_values))[order]) >= 0).all()


class _Drawn(Curves):
    """AUCs by agent on one target, drawn by the test."""

    def __init__(self, aucs: dict[str, list[float]]) -> None:
        self._aucs = aucs

    def best(self, target: str, arm: Arm) -> pd.DataFrame:
        values = self._aucs.get(arm.agent, []) if target == X5 else []
        columns = {"auc": values, "first_tenth": values, "seed": range(len(values)), "source_cell": None}
        return pd.DataFrame(columns)


def _verdicts(aucs: dict[str, list[float]], *parts: Comparison) -> list[str]:
    return [
        finding.verdict
        for _, found in findings(_Drawn(aucs), _Drawn({}), [Claim("x", "", "", parts)])
        for finding in found
    ]


def test_a_verdict_is_that_of_the_corrected_test() -> None:
    noise = np.random.default_rng(0).normal(0, 1, (3, 10))
    aucs = {"dqn": list(100 + noise[0]), "es": list(110 + noise[1]), "delta_es": list(100.2 + noise[2])}
    found = _verdicts(aucs, Comparison(X5, ES, DQN), Comparison(X5, DQN, ES), Comparison(X5, DELTA_ES, DQN))
    assert found == ["confirmed", "contradicted", "undecided"]
    assert _verdicts(aucs, Comparison(X5, DELTA_ES, DQN, "no worse")) == ["confirmed"]
    assert _verdicts(aucs, Comparison(X5, DELTA_ES, ES, "no worse")) == ["contradicted before correction"]
    assert _verdicts({"dqn": [1.0]}, Comparison(X5, ES, DQN)) == ["not run"]


class _Crossed(Curves):
    """Four seeds on each of three networks: es varies three times as much as delta_es, and with the share of advice."""

    def __init__(self) -> None:
        pass

    def best(self, target: str, arm: Arm) -> pd.DataFrame:
        at = float(dict(arm.settings)["advice_fraction"])
        network, seed = np.repeat(np.arange(3.0), 4), np.tile(np.arange(4), 3)
        auc = 10 * network + (3 * seed + 20 * at * (1 + network / 10) if arm == Arm("es", arm.settings) else seed)
        return pd.DataFrame({"auc": auc, "seed": seed, "source_cell": network})


def test_sensitivity_and_variance_have_a_number_per_source_network() -> None:
    curves = _Crossed()
    assert list(spreads(curves, X5, ES, "range")) == pytest.approx([15, 16.5, 18])
    assert list(spreads(curves, X5, DELTA_ES, "range")) == [0, 0, 0]
    assert list(spreads(curves, X5, ES, "log_variance")) == pytest.approx([np.log(9 * 5 / 3)] * 3)
    parts = [Comparison(X5, ES, DELTA_ES, column=column, shares=True) for column in ("range", "log_variance")]  # type: ignore[arg-type]
    wide, varied = (
        each for _, found in findings(_Drawn({}), curves, [Claim("x", "", "", tuple(parts))]) for each in found
    )
    assert wide.difference is not None
    assert varied.difference is not None
    assert wide.p == pytest.approx(stats.ttest_1samp([15, 16.5, 18], 0).pvalue)
    assert varied.difference.value == pytest.approx(np.log(9))
    assert (wide.seeds, wide.verdict) == (3, "confirmed")


def test_every_verdict_has_its_place_in_the_summary() -> None:
    draws = np.random.default_rng(0).normal(0, 1, (2, 12))
    parts = [Comparison(X5, ES, DQN), Comparison(X5, DQN, ES), Comparison(X5, ES, DQN, "no worse")]
    parts += [Comparison(X5, DQN, ES, "no worse"), Comparison(X5, ES, DQN, column="first_tenth")]
    for lead in np.linspace(-30, 30, 121):
        aucs = {"dqn": list(100 + draws[0]), "es": list(100 + lead / 10 + draws[1])}
        assert set(_verdicts(aucs, *parts)) <= set(VERDICTS)


def test_the_correction_can_take_a_claim_back() -> None:
    draws = np.random.default_rng(1).normal(0, 1, (2, 12))
    aucs = {"dqn": list(draws[0]), "es": list(draws[1] + 1.0)}
    part = Comparison(X5, ES, DQN)
    p = stats.ttest_rel(aucs["es"], aucs["dqn"]).pvalue
    assert 0.05 / 3 < p < 0.05
    assert _verdicts(aucs, part) == ["confirmed"]
    others = [Comparison(X5, ES, DQN, column="first_tenth"), Comparison(X5, DQN, ES)]
    assert _verdicts(aucs, part, *others)[0] == "confirmed before correction only"


def test_every_claim_is_of_agents_and_targets_that_there_are() -> None:
    for part in (part for claim in CLAIMS for part in claim.parts):
        task = parse_task(part.target)
        for arm in (part.better, part.worse):
            source = Source(task=task.name, kind="learned", cell_id="0" * 16, steps=None if task.tabular else 1)
            needs = arm.agent not in ("dqn", "q_learning")
            Cell.create(arm.agent, part.target, 0, dict(arm.settings), source if needs else None)


def _sweeps(target: str, agent: str, settings: dict[str, float]) -> tuple[str, ...]:
    if target.startswith("acrobot") and settings.get("advice_fraction") != 0.5:
        return ("table1", SAFE)
    if agent in ("safe_start", "jsrl"):
        return BASELINES[:1]
    return (FRACTIONS,) if settings.get("advice_fraction") == 0.5 else ("table1", BASELINES[0], FRACTIONS)


class _Made:
    """A dataset of every row but the last, of all agents, with few seeds of Acrobot and two source networks of es."""

    def __init__(self) -> None:
        rng, rows, points = np.random.default_rng(0), [], []
        arms: list[tuple[str, dict[str, float]]] = [("dqn", {}), ("warm_start", {}), ("jsrl", {}), ("safe_start", {})]
        arms += [(agent, {"advice_fraction": at}) for agent in ("es", "delta_es") for at in (0.25, 0.5)]
        for target in ROWS[:-1]:
            for place, (agent, settings) in enumerate(arms):
                for seed in range(5 if target.startswith("acrobot") else 10):
                    for network in ("a", "b") if agent == "es" else ("a",):
                        source = Source(
                            task=parse_task(target).family.name, kind="learned", cell_id=network * 16, steps=1
                        )
                        cell = Cell.create(agent, target, seed, settings, None if agent == "dqn" else source)
                        auc = 100.0 + place + float(rng.normal())
                        rows += [
                            {
                                "sweep": sweep,
                                "cell_id": cell.id,
                                "agent": agent,
                                "task": cell.task,
                                "seed": seed,
                                "auc": auc,
                                "source": "none" if agent == "dqn" else "learned",
                                "group": cell.group,
                                "seconds": 1.0,
                                "source_cell": None if agent == "dqn" else network * 16,
                                "cell": json.dumps(cell.to_json()),
                            }
                            for sweep in _sweeps(target, agent, settings)
                        ]
                        points += [
                            {"cell_id": cell.id, "episode": at, "greedy_return": auc, "advised_factor": 0.5}
                            for at in (0, 10)
                        ]
        short = Cell.create("safe_start", X5, 0, {"episodes": 20}, source)
        rows.append(rows[-1] | {"cell_id": short.id, "auc": 1e6, "task": short.task, "group": short.group})
        rows[-1] |= {"agent": "safe_start", "cell": json.dumps(short.to_json())}
        self.cells, self._points = pd.DataFrame(rows), pd.DataFrame(points)

    def points(self, cell_ids: object) -> pd.DataFrame:
        return self._points


def test_further_rows_agents_and_source_networks_find_their_place(tmp_path: Path) -> None:
    made = cast(Dataset, _Made())
    parts = published(made)
    text = page(made, parts)
    for target in ROWS[:-1]:
        assert f"|{target}|warm_start|{5 if target.startswith('acrobot') else 10}|1|" in text
    assert "|cartpole:gravity=5x|es|10|2|" in text
    assert "|lunar_lander:mass=1.5|all|0|-|not run yet|" in text
    deep = [
        line for line in text.splitlines() if line.startswith(("|*Acrobot", "|*Lunar", "|*Reacher", "|*on average"))
    ]
    assert len(deep) >= 5
    assert not [line for line in deep if "not run" in line]
    assert "|acrobot|40 of 80|`deltatune sweep reproduction --tasks acrobot --seeds 10 --name table1-acrobot`|" in text
    assert "|cartpole|80 of 160|" in text
    assert "## Figure 4" in text
    short = text.partition("## In short")[2].partition("## Method")[0]
    assert "Against `dqn` on deep targets, after Holm's correction for 24 comparisons: `es` is better on" in short
    gaps = [difference(parts.paper.paired(target, DELTA_ES, ES)) for target in ROWS[:-1]]
    better = sum(p < 0.05 for p in holm([gap.p for gap in gaps if gap is not None and gap.p is not None]))
    assert better > 0
    assert f"the same advice without delta, on {better} of 8 deep targets, and worse on none" in short
    led = mean_gain(parts.paper, ROWS[:-1], DELTA_ES, ES)
    assert led.low is not None
    assert led.low > 0
    assert f"as a mean over these targets: {interval(led)}." in short
    shown = "worse than `dqn` on none of 8 targets, and shown to lose less than 5% on 8 of them"
    assert f"`safe_start` is {shown}" in short
    rivals = text.partition("## Other uses of a source")[2].partition("## An agent that is safe")[0]
    assert f"|{X5}|jsrl|10|" in rivals
    assert f"|{X5}|delta_es - es|10|" in rivals
    safe_part = text.partition("## An agent that is safe")[2].partition("## Verdicts")[0]
    for agent in ("safe_start", "dqn", "es", "delta_es", "warm_start", "jsrl"):
        assert f"|{agent}|" in safe_part
    assert "1000000" not in text
    assert {"table1.png", "figure4.png", "safe.png"} <= {path.name for path in draw(parts, tmp_path)}


def test_the_gain_of_the_safe_agent_weighs_targets_the_same_and_is_students_on_one() -> None:
    curves = published(cast(Dataset, _Made())).safe
    standings = safe.standings(curves)
    assert standings is not None
    assert {X5, LONG} < set(standings.tasks)
    each = {task: mean_gain(curves, [task], safe.SAFE, DELTA_ES) for task in standings.tasks}
    student = difference(curves.paired(X5, safe.SAFE, DELTA_ES))
    assert student is not None
    assert each[X5].value == pytest.approx(student.value / 178.05)
    assert (each[X5].low, each[X5].high, each[X5].p) == pytest.approx(
        (student.low / 178.05, student.high / 178.05, student.p)  # type: ignore[operator]
    )
    together = mean_gain(curves, standings.tasks, safe.SAFE, DELTA_ES)
    assert together.value == pytest.approx(np.mean([gain.value for gain in each.values()]))
    assert together.df is not None
    assert together.df >= min(gain.df for gain in each.values() if gain.df is not None)


def test_intervals_are_over_source_networks_where_they_are_crossed_with_seeds() -> None:
    curves = published(cast(Dataset, _Made())).paper
    assert len(curves.best(X5, ES)) == 20
    found = curves.mean(X5, ES)
    assert found is not None
    assert found == crossed.mean(crossed.rectangle(curves.best(X5, ES), "auc"))


def test_the_page_is_that_of_the_published_dataset() -> None:
    written = (PUBLISHED.parent / "reproduction.md").read_text()
    dataset = Dataset(PUBLISHED)
    assert page(dataset, published(dataset)) == written, "run python -m benchmarks.reproduction"
