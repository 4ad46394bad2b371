"""What a sweep gives to other programs."""

from __future__ import annotations

import json
import re
from pathlib import Path

import gymnasium
import pandas as pd
import pytest
import yaml

from orchestrator.analysis.contrasts.table import number_table as contrast_table
from orchestrator.analysis.findings import Findings, find
from orchestrator.analysis.tables.paper_table1 import TABLE_1, same_row
from orchestrator.analysis.tables.summary_table import number_table
from orchestrator.export.formats import FORMATS, write
from orchestrator.export.latex import escape, table_1
from orchestrator.export.sb3 import dqn_arguments
from orchestrator.results.sweep_folder import Results
from search_spaces.loading import parse
from trainables.agents.registry import AGENTS
from trainables.cell import Cell, Source
from trainables.errors import InputError
from trainables.tasks.registry import parse_task

TASK = "cartpole:gravity=5x"


@pytest.fixture
def small(finished: Path) -> Findings:
    return find(Results.open(finished, "small"))


def deep(storage: Path, **settings: object) -> Findings:
    """Findings of dqn and delta_es on CartPole, two seeds each, that were never run."""
    space = {
        "schema": 1,
        "name": "deep_1",
        "seeds": 2,
        "scenarios": [{"source": {"task": "cartpole", "agent": "dqn"}, "targets": [TASK]}],
        "agents": {"dqn": {}, "delta_es": {}},
    }
    task = parse_task(TASK)
    source = Source(task="cartpole", kind="learned", cell_id="0" * 16, checkpoint="best", steps=1000)
    rows = []
    for agent, knowledge, auc in (("dqn", None, 100.0), ("delta_es", source, 120.0)):
        values = AGENTS[agent].resolve(task, dict(settings)).model_dump()
        for seed in range(2):
            cell = Cell.create(agent, task.name, seed, values, knowledge)
            row = {"cell_id": cell.id, "stage": "transfer", "status": "done", "agent": agent, "task": cell.task}
            row |= {"source": "learned" if knowledge else "none", "source_task": "cartpole" if knowledge else None}
            row |= {"seed": seed, "group": cell.group, "auc": auc + seed, "training_auc": auc, "asymptotic": auc}
            row |= {"initial_return": 9.0, "steps": 40_000 + seed, "hyperparameters": json.dumps(cell.hyperparameters)}
            rows.append(row)
    results = Results.create(storage, "deep_1", parse("deep", space))
    return find(results, (pd.DataFrame(rows), pd.DataFrame({"cell_id": []})))


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_the_results_are_the_same_as_csv_and_as_parquet(small: Findings, tmp_path: Path, form: str) -> None:
    written = write(small, form, tmp_path / "out")
    names = [f"{name}.{form}" for name in ("configurations", "contrasts", "cells", "points")]
    assert [path.name for path in written.files] == names
    tables = (number_table(small.groups), contrast_table(small.contrasts), small.cells, small.points)
    for path, table in zip(written.files, tables, strict=True):
        read = pd.read_csv(path) if form == "csv" else pd.read_parquet(path)
        assert list(read.columns) == list(table.columns)
        assert len(read) == len(table)
    assert read["greedy_return"].sum() == pytest.approx(small.points["greedy_return"].sum())
    assert {path.name for path in (tmp_path / "out").iterdir()} == set(names)


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_a_file_is_written_as_one_file_with_a_number_in_every_cell(small: Findings, tmp_path: Path, form: str) -> None:
    path = tmp_path / "new" / f"a.{form}"
    assert write(small, form, path).files == (path,)
    table = pd.read_csv(path) if form == "csv" else pd.read_parquet(path)
    best = next(group for group in small.groups if group.against_base)
    row = table[table["hyperparameters"] == json.dumps(dict(best.hyperparameters), sort_keys=True)]
    row = row[(row["agent"] == best.agent) & (row["task"] == best.task) & (row["source"] == best.source)].iloc[0]
    assert best.auc is not None
    assert best.against_base is not None
    assert (row["auc"], row["auc_sd"]) == pytest.approx((best.auc.value, best.auc.sd))
    assert (row["transfer_ratio"], row["transfer_ratio_low"]) == pytest.approx(
        (best.against_base.transfer_ratio.value, best.against_base.transfer_ratio.low)
    )
    assert row["verdict"] == best.verdict
    with pytest.raises(InputError, match=f"a.other is the name|give --format {form}"):
        write(small, {"csv": "parquet", "parquet": "csv"}[form], path)


def test_yaml_and_json_hold_the_same(small: Findings, tmp_path: Path) -> None:
    as_yaml = write(small, "yaml", tmp_path / "a.yaml").files[0]
    as_json = write(small, "json", tmp_path / "a.json").files[0]
    assert yaml.safe_load(as_yaml.read_text()) == json.loads(as_json.read_text())


@pytest.mark.parametrize("agent", ["dqn", "delta_es"])
def test_stable_baselines_takes_the_arguments(tmp_path: Path, agent: str) -> None:
    sb3 = pytest.importorskip("stable_baselines3", reason="stable-baselines3 is not installed")
    path = write(deep(tmp_path), "sb3", tmp_path / "sb3.json").files[0]
    entry = next(entry for entry in json.loads(path.read_text())["dqn"] if entry["agent"] == agent)
    model = sb3.DQN("MlpPolicy", gymnasium.make("CartPole-v1"), **entry["kwargs"])
    values = AGENTS[agent].resolve(parse_task(TASK), {}).model_dump()
    assert (model.learning_rate, model.gamma) == (values["learning_rate"], values["gamma"])
    assert (model.batch_size, model.buffer_size) == (values["batch_size"], values["replay_capacity"])
    assert model.policy.net_arch == [values["hidden_size"]] * values["hidden_layers"]
    assert model.replay_buffer.handle_timeout_termination
    model.learn(model.learning_starts + 3)
    assert model._n_updates == 3
    assert entry["total_timesteps"] == 40_000


def test_what_stable_baselines_does_not_have_is_said(tmp_path: Path) -> None:
    plain, advised = (entry["without_counterpart"] for entry in dqn_arguments(deep(tmp_path))["dqn"])
    assert {"epsilon_decay", "loss", "initialisation"} <= set(plain)
    assert set(advised) - set(plain) == {
        "advice_fraction",
        "delta_after_advice",
        "delta_learning_rate",
        "evaluation_policy",
    }
    known = {*AGENTS["delta_es"].hyperparameters.model_fields, "initialisation"}
    assert set(advised) <= known


def test_a_linear_epsilon_has_the_mean_of_the_exponential_one(tmp_path: Path) -> None:
    made = deep(tmp_path, episodes=4000, epsilon_decay=500.0)
    fraction = dqn_arguments(made)["dqn"][0]["kwargs"]["exploration_fraction"]
    assert fraction / 2 == pytest.approx(500 / 4000, rel=1e-3)


def test_a_sweep_without_deep_agents_has_nothing_for_stable_baselines(small: Findings, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'small' has no deep agent"):
        write(small, "sb3", tmp_path / "x.json")


def test_an_unknown_format_is_refused(small: Findings, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unknown format 'ymal': did you mean 'yaml'"):
        write(small, "ymal", tmp_path / "x")


@pytest.mark.parametrize("form", ["yaml", "json", "sb3", "latex"])
def test_nothing_is_exported_before_something_is_done(small: Findings, tmp_path: Path, form: str) -> None:
    empty = find(small.results, (small.cells.assign(status="missing", auc=None), small.points))
    with pytest.raises(InputError, match="no configuration whose every seed is done"):
        write(empty, form, tmp_path / "x")
    assert not (tmp_path / "x").exists()


def test_the_command_offers_every_format() -> None:
    from typer.testing import CliRunner

    from deltatune.cli.main import app

    text = CliRunner().invoke(app, ["export", "--help"], env={"COLUMNS": "300"}).output
    assert all(name in text for name in FORMATS)


def test_latex_is_a_whole_table(small: Findings) -> None:
    text = table_1(small)
    for name in ("table", "tabular"):
        assert text.count(rf"\begin{{{name}}}") == text.count(rf"\end{{{name}}}") == 1
    for rule in (r"\toprule", r"\bottomrule", r"\caption{"):
        assert text.count(rule) == 1
    rows = [line for line in text.splitlines() if line.startswith(r"\quad")]
    assert len(rows) == len(small.best)
    columns = re.search(r"\\begin{tabular}{(\w+)}", text)
    assert columns is not None
    for line in [*rows, next(line for line in text.splitlines() if line.startswith("Agent"))]:
        assert line.endswith(r" \\")
        assert len(re.findall(r"(?<!\\)&", line)) == len(columns[1]) - 1
    assert text.count("{") == text.count("}")
    assert not re.search(r"(?<!\\)[_#]", text)


def test_latex_has_the_papers_numbers_where_the_row_is_the_papers(tmp_path: Path) -> None:
    assert "$163.80$ (14.1)" in table_1(deep(tmp_path / "a"))
    assert "Paper" not in table_1(deep(tmp_path / "b", episodes=50))


@pytest.mark.parametrize("text", ["a_b & 50% #1 $x$ {y}", "back\\slash ~ ^ | < >", "line\nend"])
def test_nothing_in_a_text_is_a_command_of_latex(text: str) -> None:
    plain = re.sub(r"\\text(backslash|asciitilde|asciicircum|bar|less|greater){}|\\[&%$#_{}]", "", escape(text))
    assert not re.search(r"[\\&%$#_{}~^|<>\n]", plain)


def test_only_the_papers_own_settings_make_a_row_the_papers(tmp_path: Path) -> None:
    rows = {group.agent: same_row(group) for group in deep(tmp_path / "a").groups}
    assert rows == {"dqn": TABLE_1[TASK][0], "delta_es": TABLE_1[TASK][2]}
    assert not any(same_row(group) for group in deep(tmp_path / "b", gamma=0.9).groups)
