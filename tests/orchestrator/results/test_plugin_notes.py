"""What a sweep notes of custom code, so that its results can be read elsewhere."""

from __future__ import annotations

import json
from pathlib import Path

import yaml

from orchestrator.results import plugin_notes
from search_spaces.loading import load

EXAMPLE = Path(__file__).parents[3] / "docs" / "examples" / "tank.py"


def test_the_tasks_of_a_library_are_noted_too(tmp_path: Path) -> None:
    for name in ("tank.py", "other.py"):
        (tmp_path / name).write_bytes(EXAMPLE.read_bytes())
    source = {"task": "tank.py:Task", "agent": "dqn", "library": ["other.py:Task"]}
    scenario = {"source": source, "targets": ["tank.py:Task:leak=1.5x"]}
    data = {"schema": 1, "name": "noted", "seeds": 1, "scenarios": [scenario], "agents": {"delta_select_es": {}}}
    (tmp_path / "noted.yaml").write_text(yaml.safe_dump(data))
    plugin_notes.keep(tmp_path, load(str(tmp_path / "noted.yaml")))
    noted = json.loads((tmp_path / plugin_notes.FILE).read_text())
    assert [name.partition("@")[0] for name in noted if name not in ("schema", "checksum")] == ["tank.py", "other.py"]
