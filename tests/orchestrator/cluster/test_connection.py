"""What happens where Ray does not start."""

from __future__ import annotations

from typing import Any

import pytest
import ray

from orchestrator.cluster.connection import connected
from orchestrator.cluster.resources import Resources
from orchestrator.errors import SweepError


def test_a_ray_that_does_not_start_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def init(**options: Any) -> None:
        raise Exception("The current node timed out during startup. This could happen because the raylet failed.")

    monkeypatch.setattr(ray, "init", init)
    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    with (
        pytest.raises(SweepError, match=r"^Ray did not start on this machine \(The current node timed out .*startup\)"),
        connected(1, None, Resources()),
    ):
        pass
