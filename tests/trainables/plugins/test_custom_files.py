"""Custom files: what a cell's name says of them, when they run and when they never do, and how they reach a worker."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from trainables.cell import Cell
from trainables.custom import load
from trainables.errors import InputError
from trainables.plugins import loader
from trainables.tasks.env_checker import rollout
from trainables.tasks.make import make_env
from trainables.tasks.registry import parse_task
from trainables.training.cell_run import run_cell
from trainables.training.train import train

ROOT = Path(__file__).parents[3]
TANK = ROOT / "docs" / "examples" / "tank.py"
SMALL = {"episodes": 4, "evaluate_every": 2, "evaluation_episodes": 2, "hidden_size": 8, "batch_size": 8}


@pytest.fixture
def tank(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the example, beside which the test runs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.py").write_bytes(TANK.read_bytes())
    return tmp_path / "tank.py"


def test_a_canonical_name_holds_the_files_name_and_the_hash_of_its_content(tank: Path) -> None:
    name = load("tank.py:Task:pump=2x,leak=0.05")
    assert name.startswith(f"tank.py@{loader.pin_of(tank.read_bytes())}:Task")
    assert parse_task(name).name == f"tank.py@{loader.pin_of(tank.read_bytes())}:Task:pump=0.2"
    assert load(f"{tank}:Task") == load("./tank.py:Task") == load("tank.py:Task")


def test_another_content_is_another_cell_and_line_endings_are_none(tank: Path) -> None:
    before = Cell.create("dqn", load("tank.py:Task"), 0, SMALL).id
    tank.write_bytes(tank.read_bytes().replace(b"\n", b"\r\n"))
    assert Cell.create("dqn", load("tank.py:Task"), 0, SMALL).id == before
    tank.write_text(TANK.read_text() + "# another word\n")
    assert Cell.create("dqn", load("tank.py:Task"), 0, SMALL).id != before


def test_cells_of_built_in_tasks_keep_their_ids() -> None:
    assert Cell.create("dqn", "cartpole:gravity=5x", 0).id == "09b5c30092686f7c"
    assert Cell.create("q_learning", "windy_gridworld:wind=small", 3).id == "d08be43df7dcc096"


def test_reading_a_cell_never_runs_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("trap.py").write_text("from pathlib import Path\nPath('sprung').touch()\n")
    pin = loader.pin_of(Path("trap.py").read_bytes())
    raw = {"schema": 1, "agent": "dqn", "task": f"trap.py@{pin}:Task", "seed": 0, "hyperparameters": {}, "source": None}
    cell = Cell.from_json(raw)
    assert cell.task == f"trap.py@{pin}:Task"
    with pytest.raises(InputError, match=r"needs trap\.py as it was then .*--file trap\.py"):
        train(cell)
    with pytest.raises(InputError, match="names a file that is not loaded"):
        Cell.from_json(raw | {"task": "trap.py:Task"})
    with pytest.raises(InputError, match=r"the agent trap\.py@\w+:Agent needs trap\.py"):
        train(Cell.from_json(raw | {"agent": f"trap.py@{pin}:Agent", "task": "cartpole"}))
    assert not Path("sprung").exists()


def test_a_cell_that_is_read_where_its_file_is_not_keeps_its_id(tank: Path) -> None:
    cell = Cell.create("dqn", load("tank.py:Task:leak=2x"), 1, SMALL)
    code = "import json, sys; from trainables.cell import Cell; print(Cell.from_json(json.load(sys.stdin)).id)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        input=json.dumps(cell.to_json()),
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    assert done.stdout.strip() == cell.id


def test_a_changed_file_is_refused_where_the_old_one_is_asked_for(tank: Path) -> None:
    name = load("tank.py:Task")
    tank.write_text(TANK.read_text() + "# changed since\n")
    with pytest.raises(InputError, match=r"tank\.py is no longer the file that was used: it is tank\.py@\w+, not @"):
        load(name)


def test_a_worker_gets_the_file_and_computes_the_same_bits(tank: Path) -> None:
    """In a process that has no such file: what a worker on another machine sees."""
    cell = Cell.create("dqn", load("tank.py:Task:leak=2x"), 0, SMALL)
    here = run_cell(cell, lambda cell: None)
    key = cell.task.rpartition(":Task")[0]
    packed = {key: loader.packed()[key].decode()}
    code = (
        "import json, sys; from trainables.plugins import loader as files; from trainables.cell import Cell\n"
        "from trainables.training.cell_run import run_cell\n"
        "data = json.load(sys.stdin); files.install({k: v.encode() for k, v in data['files'].items()})\n"
        "print(run_cell(Cell.from_json(data['cell']), lambda cell: None).digest)"
    )
    data = json.dumps({"files": packed, "cell": cell.to_json()})
    done = subprocess.run(
        [sys.executable, "-c", code], input=data, capture_output=True, text=True, check=True, cwd=ROOT
    )
    assert done.stdout.strip() == here.digest


def test_a_file_that_was_altered_on_its_way_is_refused() -> None:
    with pytest.raises(InputError, match=r"x\.py@00000000 arrived with another content"):
        loader.install({"x.py@00000000": b"print('never')"})


def test_a_file_that_does_not_run_on_a_worker_fails_its_own_cells_alone() -> None:
    source = b"import only_on_the_driver\n"
    key = f"needy.py@{loader.pin_of(source)}"
    loader.install({key: source})
    outcome = run_cell(Cell.create("dqn", f"{key}:Task", 0, SMALL), lambda cell: None)
    assert "cannot be loaded here (needy.py:1: ModuleNotFoundError: No module named 'only_on_the_driver')" in str(
        outcome.error
    )
    assert run_cell(Cell.create("q_learning", "windy_gridworld", 0, {"episodes": 1}), lambda cell: None).error is None


def test_two_files_of_one_name_live_side_by_side(tank: Path) -> None:
    first = parse_task(load("tank.py:Task"))
    tank.write_text(TANK.read_text().replace("level - 0.5", "level - 0.7"))
    second = parse_task(load("tank.py:Task"))
    assert first.name != second.name
    assert rollout(make_env(first), 5) != rollout(make_env(second), 5)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("def broken(:\n", r"own\.py:1: not Python \("),
        ("x = 1\n\ny = x.nothing\n", r"own\.py:3: AttributeError: 'int' object has no attribute 'nothing'"),
        ("import no_such_module\n", r"own\.py:1: ModuleNotFoundError"),
        ("Tasks = 3\n", r"own\.py has no 'Task'; did you mean 'Tasks'\?"),
        (
            "from __future__ import annotations\nimport math\nfrom math import inf\nfrom pathlib import Path\n"
            "class Pump: ...\nvalve = Pump()\n",
            r"own\.py has no 'Task': there is inf, Pump, valve$",
        ),
        ("Task = 3\n", r"own\.py:Task is not a task \(it is 3\): make one with deltatune\.task"),
        ("def Task():\n    return 1 / 0\n", r"calling it failed \(ZeroDivisionError: division by zero \(own\.py:2\)\)"),
    ],
)
def test_a_file_that_does_not_work_is_one_sentence_with_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(text)
    with pytest.raises(InputError, match=says) as caught:
        parse_task(load("own.py:Task"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("nowhere.py:Task", "cannot read nowhere.py: No such file"),
        ("own.py", "'own.py' is not FILE.py:NAME"),
        ("own.py:", "'own.py:' is not FILE.py:NAME"),
        ("own.py:a-b", "'own.py:a-b' is not FILE.py:NAME"),
    ],
)
def test_a_bad_name_is_one_sentence(name: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        load(name)
