"""Source networks crossed with seeds: intervals for which both are random, and how much either decides."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from dashboards.report import sections
from orchestrator.analysis import statistics
from orchestrator.analysis.findings import Findings, find
from orchestrator.analysis.inference import crossed
from orchestrator.analysis.inference.pairs import difference, paired
from orchestrator.planning.arms import Label
from orchestrator.results.sweep_folder import Results
from orchestrator.results.tables.cell_row import cell_row
from search_spaces.loading import parse
from trainables.cell import Cell, Source
from trainables.tasks.registry import parse_task

TARGET = parse_task("cartpole:gravity=5x").name
TABLE = np.array([[3.0, 5.0, 4.0, 8.0], [2.0, 4.5, 3.5, 6.0], [7.0, 8.0, 9.5, 12.0]])


def draw(rng: np.random.Generator, sources: int, seeds: int, sd: tuple[float, float, float]) -> np.ndarray:
    """A table with these standard deviations between sources, between seeds, and of the rest."""
    between, within = rng.normal(0, sd[0], (sources, 1)), rng.normal(0, sd[1], (1, seeds))
    return between + within + rng.normal(0, sd[2], (sources, seeds))


def cells(table: np.ndarray) -> pd.DataFrame:
    rows = [
        {"seed": seed, "source_cell": f"s{source}", "auc": table[source, seed]}
        for source in range(table.shape[0])
        for seed in range(table.shape[1])
    ]
    return pd.DataFrame(rows).sample(frac=1, random_state=0)


def test_mean_squares_by_their_sums() -> None:
    centre = TABLE.mean()
    rows = sum(4 * (TABLE[i].mean() - centre) ** 2 for i in range(3)) / 2
    columns = sum(3 * (TABLE[:, j].mean() - centre) ** 2 for j in range(4)) / 3
    rest = sum((TABLE[i, j] - TABLE[i].mean() - TABLE[:, j].mean() + centre) ** 2 for i in range(3) for j in range(4))
    assert crossed.mean_squares(TABLE) == pytest.approx((rows, columns, rest / 6), rel=1e-12)
    estimate = crossed.mean(TABLE)
    error = np.sqrt((rows + columns - rest / 6) / 12)
    df = (rows + columns - rest / 6) ** 2 / (rows**2 / 2 + columns**2 / 3 + (rest / 6) ** 2 / 6)
    half = stats.t.ppf(0.975, df) * error
    assert [estimate.value, estimate.low, estimate.high, estimate.p] == pytest.approx(
        [centre, centre - half, centre + half, 2 * stats.t.sf(centre / error, df)], rel=1e-12
    )


def test_shares_by_the_method_of_moments() -> None:
    rows, columns, rest = crossed.mean_squares(TABLE)
    parts = np.array([(rows - rest) / 4, (columns - rest) / 3, rest])
    found = crossed.components(TABLE)
    assert found is not None
    assert [found.sources.value, found.seeds.value, found.rest.value] == pytest.approx(parts / parts.sum(), rel=1e-12)


def test_one_source_model_is_students_t_over_seeds() -> None:
    one = statistics.mean(list(TABLE[0]))
    estimate = crossed.mean(TABLE[:1])
    assert [estimate.value, estimate.low, estimate.high] == pytest.approx([one.value, one.low, one.high], rel=1e-12)
    assert crossed.components(TABLE[:1]) is None
    assert crossed.mean(TABLE[:1, :1]).low is None


def test_without_any_variance_there_are_no_shares() -> None:
    flat = np.ones((3, 4))
    assert crossed.components(flat) is None
    assert (crossed.mean(flat).low, crossed.mean(flat).high, crossed.mean(flat).p) == (1.0, 1.0, 0.0)


@pytest.mark.parametrize("sd", [(1.0, 0.5, 0.7), (0.0, 0.5, 0.7), (0.3, 1.0, 0.2)])
def test_the_interval_of_a_mean_covers_over_sources_and_seeds(sd: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(0)
    covered = flat = 0
    for _ in range(600):
        table = draw(rng, 5, 8, sd)
        estimate, naive = crossed.mean(table), statistics.mean(list(table.ravel()))
        covered += (estimate.low or 0) <= 0 <= (estimate.high or 0)
        flat += (naive.low or 0) <= 0 <= (naive.high or 0)
    assert covered / 600 > 0.925
    assert flat < covered


@pytest.mark.parametrize("sd", [(1.0, 0.5, 0.7), (0.5, 1.0, 1.0)])
def test_the_shares_are_those_that_the_data_were_made_with(sd: tuple[float, float, float]) -> None:
    rng, truth = np.random.default_rng(0), np.square(sd) / np.square(sd).sum()
    large = crossed.components(draw(rng, 300, 300, sd))
    assert large is not None
    assert [large.sources.value, large.seeds.value, large.rest.value] == pytest.approx(truth, abs=0.06)
    hits = np.zeros(3)
    for _ in range(150):
        found = crossed.components(draw(rng, 6, 10, sd))
        assert found is not None
        for at, share in enumerate((found.sources, found.seeds, found.rest)):
            hits[at] += (share.low or 0) <= truth[at] <= (share.high or 0)
    assert (hits / 150 > 0.9).all()


def test_cells_are_paired_by_seed_and_source_model() -> None:
    other = TABLE - np.array([[1.0], [2.0], [4.0]])
    both = paired(cells(TABLE), cells(other))
    assert len(both) == 12
    gap = difference(both, "auc")
    assert gap is not None
    assert gap == crossed.mean(TABLE - other)
    without = pd.DataFrame({"seed": range(4), "source_cell": None, "auc": [1.0, 2.0, 3.0, 4.0]})
    one = difference(paired(cells(TABLE), without), "auc")
    assert one == crossed.mean(TABLE - without["auc"].to_numpy())
    back = difference(paired(without, cells(TABLE)), "auc")
    assert back is not None
    assert one is not None
    assert back.value == -one.value
    assert back.p == pytest.approx(one.p)


def test_a_source_model_that_lacks_a_seed_is_left_out() -> None:
    rows = cells(TABLE)
    rows = rows[~((rows["seed"] == 3) & (rows["source_cell"] == "s2"))]
    np.testing.assert_array_equal(crossed.rectangle(rows, "auc"), TABLE[:2])


def made(folder: Path, models: int) -> Findings:
    """A sweep with so many source networks crossed with four seeds."""
    space = {
        "schema": 1,
        "name": "crossed",
        "seeds": 4,
        "scenarios": [{"source": {"task": "cartpole", "agent": "dqn"}, "targets": [TARGET]}],
        "agents": {"dqn": {}, "es": {}},
    }
    rows = []
    for source in range(models):
        for seed in range(4):
            given = Source(task="cartpole", kind="learned", cell_id=f"{source:016x}")
            rows.append((Cell.create("es", TARGET, seed, {}, given), TABLE[source, seed], "each"))
    rows += [(Cell.create("dqn", TARGET, seed), float(seed), "") for seed in range(4)]
    table = pd.DataFrame(
        [
            cell_row("transfer", cell, None, Label(pick))
            | {"status": "done"}
            | dict.fromkeys(("auc", "training_auc", "initial_return", "asymptotic"), auc)
            for cell, auc, pick in rows
        ]
    )
    return find(Results.create(folder, "crossed", parse("crossed", space)), (table, pd.DataFrame({"cell_id": []})))


def test_a_sweep_of_crossed_sources_says_how_much_they_decide(tmp_path: Path) -> None:
    findings = made(tmp_path, 3)
    group = next(group for group in findings.best if group.agent == "es")
    assert (group.seeds, group.sources, group.networks > 1, group.complete) == ((0, 1, 2, 3), 3, True, True)
    expected = crossed.components(TABLE)
    assert expected is not None
    assert group.estimate("variance_sources") == expected.sources
    assert group.against_base is not None
    assert group.against_base.seeds == 4
    assert group.against_base.difference == crossed.mean(TABLE - np.arange(4.0))
    assert group.auc is not None
    assert (group.auc.low, group.auc.high) == (crossed.mean(TABLE).low, crossed.mean(TABLE).high)
    section = next(each for each in sections.sections(findings, sections.figures(findings))[0] if each.id == "variance")
    assert f"{100 * expected.sources.value:.0f}% [" in section.lead
    assert "3 source networks" in section.lead
    chance = group.estimate("probability_of_improvement")
    assert chance is not None
    assert chance == statistics.probability_of_improvement(list(TABLE.T.ravel()), [0.0, 1.0, 2.0, 3.0], (4, 4))


def test_a_sweep_of_one_source_model_says_that_it_is_one_draw(tmp_path: Path) -> None:
    findings = made(tmp_path, 1)
    shown, absent = sections.sections(findings, sections.figures(findings))
    assert "one draw" in next(each.reason for each in absent if each.name == "variance")
    assert "every result is one draw" in next(section.lead for section in shown if section.id == "results")


def test_a_transfer_ratio_of_one_source_network_is_fiellers() -> None:
    without = TABLE[1:2] + 10
    assert crossed.transfer_ratio(TABLE[:1] + 12, without) == statistics.transfer_ratio(
        list(TABLE[0] + 12), list(without[0])
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_ends_of_a_transfer_ratio_are_where_the_difference_is_just_not_decided(sign: float) -> None:
    a_t, a_w = sign * (TABLE + 12), sign * np.broadcast_to(TABLE[1] + 10, TABLE.shape)
    found = crossed.transfer_ratio(a_t, a_w)
    assert found.value == pytest.approx(sign * (a_t.mean() / a_w.mean() - 1))
    assert found.low is not None
    assert found.high is not None
    assert found.low < found.value < found.high
    for end in (found.low, found.high):
        gap = crossed.mean(a_t - (1 + sign * end) * a_w)
        assert min(abs(gap.low or 0), abs(gap.high or 0)) == pytest.approx(0, abs=1e-9)


def test_a_transfer_ratio_covers_what_other_source_networks_would_have_given() -> None:
    rng, covered, narrow = np.random.default_rng(3), 0, 0
    for _ in range(300):
        a_w = 100 + rng.normal(0, 5, (1, 6)).repeat(5, axis=0)
        a_t = 1.1 * a_w + draw(rng, 5, 6, (10.0, 0.0, 5.0))
        found, seeds = crossed.transfer_ratio(a_t, a_w), statistics.transfer_ratio(list(a_t.mean(0)), list(a_w[0]))
        covered += (found.low or 0) <= 0.1 <= (found.high or 0)
        narrow += (seeds.low or 0) <= 0.1 <= (seeds.high or 0)
    assert covered >= 0.92 * 300
    assert narrow < 0.8 * 300


def test_a_transfer_ratio_without_an_interval() -> None:
    flat = np.full((3, 4), 5.0)
    assert crossed.transfer_ratio(flat, flat).value == 0
    assert (crossed.transfer_ratio(flat, flat).low, crossed.transfer_ratio(flat, flat).high) == (0, 0)
    assert crossed.transfer_ratio(TABLE, np.array([[-1.0, 1.0, -2.0, 2.0]] * 3)).undefined is not None
    assert crossed.transfer_ratio(TABLE[:, :1], flat[:, :1]).low is None
