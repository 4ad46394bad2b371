"""Ten minutes on a real cluster whose workers and nodes die at random: every bit as if nobody had."""

from __future__ import annotations

import pytest

from tests.node_killer.killer import kill


@pytest.mark.slow
@pytest.mark.cluster
def test_ten_minutes_of_dying_workers_and_nodes_change_no_bit() -> None:
    killed = kill(minutes=10, seed=1)
    assert killed.wrong == []
    assert min(killed.workers, killed.nodes) > 3, str(killed)
