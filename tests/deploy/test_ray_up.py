"""The cluster file is one that `ray up` accepts: Ray's own defaults, Ray's own schema."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

ROOT = Path(__file__).parents[2]
CONFIG = yaml.safe_load((ROOT / "deploy/cluster.yaml").read_text())
HEAD, CELLS = CONFIG["available_node_types"]["head"], CONFIG["available_node_types"]["cells"]


def _validated(config: dict[str, Any]) -> dict[str, Any]:
    """What `ray up` makes of the file before it speaks to the cloud."""
    from ray.autoscaler._private.util import prepare_config, validate_config

    prepared: dict[str, Any] = prepare_config(copy.deepcopy(config))
    validate_config(prepared)
    return prepared


def test_ray_accepts_the_file() -> None:
    prepared = _validated(CONFIG)
    assert prepared["setup_commands"] == CONFIG["setup_commands"]
    assert prepared["head_setup_commands"] == CONFIG["setup_commands"], "none of Ray's defaults, which upgrade boto3"


@pytest.mark.parametrize("change", [{"max_worker": 3}, {"max_workers": "4"}, {"max_workers": 2}])
def test_ray_finds_a_mistake(change: dict[str, Any]) -> None:
    with pytest.raises((jsonschema.ValidationError, ValueError)):
        _validated(CONFIG | change)


def test_the_head_runs_no_cells_and_the_workers_are_spot_and_fixed_in_number() -> None:
    assert HEAD["resources"] == {"CPU": 0}
    assert "InstanceMarketOptions" not in HEAD["node_config"], "a lost head is a lost cluster"
    assert CELLS["node_config"]["InstanceMarketOptions"] == {"MarketType": "spot"}
    assert CELLS["min_workers"] == CELLS["max_workers"] == CONFIG["max_workers"] > 0


def test_every_node_has_the_pinned_packages_and_the_token() -> None:
    (install,) = [command for command in CONFIG["setup_commands"] if "pip install" in command]
    assert "--constraint constraints.txt" in install
    assert "'.[all]'" in install
    assert CONFIG["file_mounts"]["/home/ubuntu/deltatune"] == "."
    assert CONFIG["file_mounts"]["/home/ubuntu/.ray/auth_token"] == "~/.ray/auth_token"
    for commands in (CONFIG["head_start_ray_commands"], CONFIG["worker_start_ray_commands"]):
        assert "RAY_AUTH_MODE=token" in commands[-1]


def test_nothing_listens_to_the_world_and_no_key_is_in_the_file() -> None:
    assert "--dashboard-host=127.0.0.1" in CONFIG["head_start_ray_commands"][-1]
    assert CELLS["node_config"]["IamInstanceProfile"] == HEAD["node_config"]["IamInstanceProfile"]
    assert {"*.env", ".git", ".venv", "results"} <= set(CONFIG["rsync_exclude"])
    text = (ROOT / "deploy/cluster.yaml").read_text()
    assert not [word for word in ("AKIA", "aws_secret", "0.0.0.0", "PASSWORD=") if word in text]
