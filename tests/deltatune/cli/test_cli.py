"""The commands: what they print, and that bad input is one sentence and exit code 2 before any work starts."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import CELLS, SPACE

from deltatune.cli.main import main
from orchestrator.results.sweep_folder import Results

pytestmark = pytest.mark.usefixtures("quick_mlflow", "quick_figures")


class Terminal:
    """Runs `deltatune` in this process."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch, self._capsys = monkeypatch, capsys

    def run(self, *words: str) -> tuple[int, str, str]:
        """(exit code, standard output, standard error)."""
        self._monkeypatch.setattr(sys, "argv", ["deltatune", *words])
        with pytest.raises(SystemExit) as end:
            main()
        printed = self._capsys.readouterr()
        return int(end.value.code or 0), printed.out, printed.err

    def json(self, *words: str) -> Any:
        """The JSON that a command prints."""
        code, out, err = self.run(*words, "--json")
        assert code == 0, err
        return json.loads(out)

    def refused(self, *words: str) -> str:
        """The one sentence with which a command is refused."""
        code, out, err = self.run(*words)
        assert (code, out) == (2, ""), err
        assert err.startswith("error: ")
        assert len(err.strip().splitlines()) == 1
        return err


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Terminal:
    return Terminal(monkeypatch, capsys)


@pytest.fixture
def space_file(tmp_path: Path) -> Path:
    path = tmp_path / "space.yaml"
    path.write_text(yaml.safe_dump(SPACE))
    return path


def test_the_catalogue_lists_everything_for_people_and_for_programs(terminal: Terminal) -> None:
    tasks = {"windy_gridworld", "supply_chain", "cartpole", "acrobot", "lunar_lander", "reacher"}
    assert tasks <= {task["name"] for task in terminal.json("tasks")}
    agents = {
        "q_learning",
        "policy_reuse",
        "ppr",
        "delta_gate",
        "confidence_gate",
        "q_warm_start",
        "dqn",
        "es",
        "delta_es",
    }
    assert agents <= {agent["name"] for agent in terminal.json("agents")}
    assert all(h["description"] for agent in terminal.json("agents") for h in agent["hyperparameters"])
    assert {"demo", "paper-figure1", "paper-gridworld"} <= {space["name"] for space in terminal.json("spaces")}
    for command in ("tasks", "agents", "spaces"):
        code, out, _ = terminal.run(command)
        assert code == 0
        assert len(out) > 100


def test_a_shown_task_says_once_what_all_agents_use_on_it(terminal: Terminal) -> None:
    _, out, _ = terminal.run("tasks", "cartpole")
    assert out.count("episodes=4000") == 1
    assert "dqn, es, delta_es" in " ".join(out.split())


def test_a_shown_space_is_a_file_to_start_from(terminal: Terminal, tmp_path: Path) -> None:
    _, text, _ = terminal.run("spaces", "demo")
    (tmp_path / "mine.yaml").write_text(text)
    assert terminal.json("spaces", str(tmp_path / "mine.yaml")) == terminal.json("spaces", "demo")


def test_bounds_of_a_scenario(terminal: Terminal) -> None:
    data = terminal.json("bounds", "windy_gridworld", "windy_gridworld:wind=reversed")
    assert data["max_abs_delta"] == pytest.approx(13.297, abs=5e-4)
    assert data["task_distance"] == pytest.approx(24.345, abs=5e-4)
    assert data["theorem1_bound"] == pytest.approx(100 * data["max_abs_delta"])
    assert data["v_source"] == pytest.approx(-35.921, abs=5e-4)
    assert data["v_target"] == pytest.approx(-19.459, abs=5e-4)
    assert data["theorem1_holds"] is True
    assert data["theorem3_holds"] is True


def test_every_command_has_help(terminal: Terminal) -> None:
    for command in (
        "tasks",
        "agents",
        "spaces",
        "sweep",
        "status",
        "export",
        "sync",
        "bounds",
        "replay",
        "report",
        "ui",
        "check",
        "init",
    ):
        code, out, _ = terminal.run(command, "--help")
        assert code == 0
        assert command in out


def test_help_and_catalogue_import_nothing_heavy() -> None:
    heavy = ("ray", "mlflow", "torch", "pandas", "numba")
    code = f"import sys, deltatune.cli.main; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_sweep_from_the_command_line(terminal: Terminal, space_file: Path, tmp_path: Path) -> None:
    words = ["sweep", str(space_file), "--local", "--workers", "1", "--storage", str(tmp_path / "r")]
    data = terminal.json(*words)
    folder = tmp_path / "r" / "small"
    assert data["sweep"] == str(folder)
    assert (data["tally"]["ran"], data["tally"]["failed"]) == (CELLS, 0)
    assert {Path(path).name for path in data["figures"]} >= {"curves.png", "curves.svg", "delta_effect.png"}
    assert data["mlflow"]["error"] is None
    code, out, _ = terminal.run(*words)
    assert code == 0
    assert f"0 cells run (0 failed), {CELLS} reused" in out
    for shown in ("transfer ratio", "delta_gate", str(folder / "best.yaml"), "curves.png", "ui --storage"):
        assert shown in out
    synced = terminal.json("sync", "small", "--storage", str(tmp_path / "r"))
    assert (synced["sweep"], len(synced["run"])) == ("small", 32)


def test_reading_commands(terminal: Terminal, finished: Path, tmp_path: Path) -> None:
    shutil.copytree(finished, tmp_path / "r")
    storage = ["--storage", str(tmp_path / "r")]
    status = terminal.json("status", "small", *storage)
    assert status["stages"]["transfer"] == {"done": CELLS - 4, "failed": 0, "stopped": 0, "missing": 0}
    assert [entry["sweep"] for entry in terminal.json("status", *storage)] == ["small"]
    output = tmp_path / "out" / "best.yaml"
    data = terminal.json("export", "small", "-o", str(output), *storage)
    assert yaml.safe_load(output.read_text()) == data
    table = tmp_path / "out" / "table1.tex"
    assert "Table 1: " in terminal.run("export", "small", "--format", "latex", "-o", str(table), *storage)[1]
    assert table.read_text().startswith("% small")
    drawn = terminal.json("report", "small", "-o", str(tmp_path / "out"), *storage)
    assert Path(drawn["report"]) == tmp_path / "out" / "report.html"
    assert all(Path(path).is_file() for path in [drawn["report"], *drawn["figures"]])
    assert "Report:   " in terminal.run("report", "small", *storage)[1]
    assert (tmp_path / "r" / "small" / "report.html").read_bytes() == Path(drawn["report"]).read_bytes()
    cell_id = next(iter(Results.open(tmp_path / "r", "small").heads()))
    assert terminal.json("replay", cell_id, *storage)["agrees"] is True
    assert "every bit agrees" in terminal.run("replay", cell_id, "--sweep", "small", *storage)[1]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["bounds", "windy_grid", "supply_chain"], "unknown task 'windy_grid': did you mean 'windy_gridworld'?"),
        (
            ["bounds", "windy_gridworld", "windy_gridworld:gravity=2"],
            "unknown context feature of windy_gridworld 'gravity'",
        ),
        (["bounds", "windy_gridworld", "windy_gridworld:wind=revers"], "one of source, small, reversed"),
        (["bounds", "windy_gridworld", "supply_chain"], "do not share states and actions"),
        (
            ["bounds", "supply_chain", "supply_chain", "--gamma", "1"],
            "gamma must be at least 0 and less than 1 (got 1.0)",
        ),
        (["sweep", "dem"], "unknown search space (or YAML file) 'dem': did you mean 'demo'?"),
        (["sweep", "demo", "--agents", "dqm"], "unknown agent of demo 'dqm'"),
        (["sweep", "demo", "--tasks", "cartpol"], "unknown task 'cartpol'"),
        (["sweep", "demo", "--tasks", "supply_chain"], "'supply_chain' is not a target task of this search space"),
        (["sweep", "demo", "--seeds", "0"], "seeds must be at least 1, or a list of seeds (got 0)"),
        (["sweep", "demo", "--set", "learning_rate=-0.5"], "learning_rate must be greater than 0 (got -0.5)"),
        (["sweep", "demo", "--set", "learning_rate=.nan"], "must be a finite number (got nan)"),
        (["sweep", "demo", "--set", "learning_rate=fast"], "learning_rate must be a number (got 'fast')"),
        (["sweep", "demo", "--set", "learning_rat=0.5"], "learning_rat is known to none of the agents"),
        (["sweep", "demo", "--set", "episodes"], "--set takes HYPERPARAMETER=VALUE (got 'episodes')"),
        (["sweep", "demo", "--storage", "/dev/null/x"], "cannot write to the folder /dev/null/x"),
        (["sweep", "demo", "--name", "../x"], "a sweep's name must be"),
        (["sweep", "demo", "--params", "/nowhere.yaml"], "cannot read /nowhere.yaml: No such file or directory"),
        (["sweep", "demo", "--tracking-uri", "gopher://x"], "a tracking URI must start with sqlite:"),
        (["sweep", "demo", "--address", "somewhere"], "a cluster's address is HOST:PORT or 'auto' (got 'somewhere')"),
        (["sweep", "demo", "--address", "127.0.0.1:1"], "no Ray cluster answers at '127.0.0.1:1': Connection refused"),
        (["sweep", "demo", "--address", "[::1]:1"], "no Ray cluster answers at '[::1]:1': "),
        (["ui", "--host", ""], "--host must be an address such as 127.0.0.1, or 0.0.0.0 for all (got '')"),
        (["sweep", "demo", "--local", "--address", "auto"], "--local runs without Ray: it cannot join a cluster (got"),
        (["sweep", "demo", "--local", "--gpus-per-cell", "1"], "--local reserves nothing: --cpus-per-cell"),
        (
            ["sweep", "gym:MountainCar-v0:gravity=2x"],
            "is a task, not a search space: write one for it with deltatune init",
        ),
        (["sweep", "cartpole"], "'cartpole' is a task, not a search space"),
        (["sweep", "/nowhere.yaml"], "cannot read /nowhere.yaml: No such file or directory"),
        (["export", "nothing"], "unknown sweep in results 'nothing'"),
        (["report", "nothing"], "unknown sweep in results 'nothing'"),
        (["replay", "../../x"], "a cell id is 16 hexadecimal digits (got '../../x')"),
        (["replay", "0" * 16], "no record of the cell 0000000000000000"),
    ],
)
def test_bad_input_is_one_sentence(
    terminal: Terminal, words: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if words[:1] == ["replay"]:
        (tmp_path / "results" / "s").mkdir(parents=True)
        (tmp_path / "results" / "s" / "sweep.json").write_text("{}")
    assert says in terminal.refused(*words)
    assert not list(tmp_path.glob("results/demo"))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"seed": 5}, "seed is not a known key"),
        ({"seeds": "five"}, "seeds must be a number, a list of seeds, or auto (got 'five')"),
        ({"agents": {"ppr": {"nu": 2}}}, "ppr: nu must be less than or equal to 1 (got 2)"),
        ({"agents": ["ppr"]}, "agents must be a mapping of keys to values (got ['ppr'])"),
        ({"schema": 7}, "schema must be 1 (got 7)"),
        ({"name": "a b/c"}, "name must be 1 to 64 letters"),
    ],
)
def test_a_bad_space_file_is_one_sentence_with_its_name(
    terminal: Terminal, space_file: Path, change: dict[str, Any], says: str
) -> None:
    space_file.write_text(yaml.safe_dump(SPACE | change))
    assert f"{space_file}: {says}" in terminal.refused("sweep", str(space_file))


@pytest.mark.parametrize("text", ["a: [1, 2", "seeds: 5\nseeds: 6", "- 1", ""])
def test_a_file_that_is_no_mapping_is_one_sentence(terminal: Terminal, space_file: Path, text: str) -> None:
    space_file.write_text(text)
    assert str(space_file) in terminal.refused("sweep", str(space_file))


def test_check_says_whether_a_task_is_sound(
    terminal: Terminal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copy(Path(__file__).parents[2] / "trainables" / "plugins" / "bad_tasks.py", tmp_path)
    monkeypatch.chdir(tmp_path)
    code, out, _ = terminal.run("check", "bad_tasks.py:Good", "--json")
    data = json.loads(out)
    assert (code, data["sound"], data["costs"]) == (1, False, [])
    assert [f["question"] for f in data["findings"] if f["passed"] is False] == ["idle acts"]
    data = terminal.json("check", "bad_tasks.py:Cut")
    assert data["sound"] is True
    assert data["environment_steps_per_second"] > 0
    assert [cost["agent"] for cost in data["costs"]] == ["dqn", "delta_es"]
    assert all(0 < cost["seconds_low"] <= cost["seconds_high"] for cost in data["costs"])
    for name in ("LateRaise", "LateNan"):  # after the rollouts, while its speed is measured
        code, out, err = terminal.run("check", f"bad_tasks.py:{name}", "--json")
        assert (code, err) == (1, "")
        finding = json.loads(out)["findings"][-1]
        assert finding["passed"] is False
        assert "bad_tasks.py:" in finding["answer"]
    refusal = terminal.refused("check", "bad_tasks.py:Learner")
    assert refusal == "error: bad_tasks.py:Learner is not a task (it is an agent): make one with deltatune.task\n"
    assert "unknown task 'bad_tasks'" in terminal.refused("check", "bad_tasks")
    assert "bad_tasks.py has no 'Goood'; did you mean 'Good'?" in terminal.refused("check", "bad_tasks.py:Goood")


def test_a_quick_look_is_small_and_says_its_cost(
    terminal: Terminal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    data = terminal.json("init", "windy_gridworld", "--quick", "-o", "q.yaml")
    assert 0 < data["seconds"][0] <= data["seconds"][1]
    space = yaml.safe_load(Path("q.yaml").read_text())
    assert (space["seeds"], space["hyperparameters"]["episodes"]) == (2, 500)
    assert space["hyperparameters"]["evaluate_every"] <= 50


def test_init_writes_a_file_once_that_a_dry_run_reads(
    terminal: Terminal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, _ = terminal.run("init", "supply_chain")
    assert code == 0
    assert yaml.safe_load(out)["name"] == "supply-chain"
    assert terminal.run("init", "supply_chain", "-o", "mine.yaml")[0] == 0
    assert yaml.safe_load(Path("mine.yaml").read_text()) == yaml.safe_load(out)
    assert "mine.yaml exists already" in terminal.refused("init", "supply_chain", "-o", "mine.yaml")
    assert "# A range:  delta_gate: {threshold: {low: 1, high: 20}}" in out
    assert "# A range:  delta_es: {advice_fraction: {low: 0.1, high: 0.5}}" in terminal.run("init", "cartpole")[1]
    data = terminal.json("sweep", "mine.yaml", "--dry-run", "--seeds", "1", "--agents", "q_learning")
    assert [(stage["stage"], stage["cells"], stage["done"]) for stage in data["stages"]] == [
        ("source", 2, 0),
        ("transfer", 2, 0),
    ]
    assert 0 < data["seconds"][0] <= data["seconds"][1]
    assert not Path("results").exists()


@pytest.mark.parametrize(
    "more", [["--dry-run"], ["--local", "--workers", "1", "--no-mlflow"]], ids=["dry run", "sweep"]
)
def test_an_auc_of_two_evaluations_is_warned_of_once(terminal: Terminal, tmp_path: Path, more: list[str]) -> None:
    few = ["sweep", "demo", "--seeds", "1", "--agents", "q_learning", "--storage", str(tmp_path), *more]
    code, _, err = terminal.run(*few, "--set", "episodes=20", "--set", "evaluate_every=20")
    assert code == 0
    assert [line for line in err.splitlines() if "evaluations" in line] == [
        "episodes=20 with evaluate_every=20 leaves 2 evaluations, one of them before training, of which the AUC is the "
        "mean: --set evaluate_every=5"
    ]
    assert "evaluations, one of them" not in terminal.run(*few[: -len(more)], "--dry-run")[2]
