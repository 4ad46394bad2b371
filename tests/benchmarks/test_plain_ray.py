"""The benchmark of Ray without deltatune measures work that was done."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest


@pytest.mark.slow
def test_each_figure_holds_at_least_the_work() -> None:
    command = [sys.executable, "-m", "benchmarks.plain_ray", "--cells", "6", "--seconds", "0.2", "--json"]
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert found["ideal"] * 2 >= 0.6
    assert min(found["actors"], found["tune"]) >= found["ideal"]
    assert found["start"] > 0
