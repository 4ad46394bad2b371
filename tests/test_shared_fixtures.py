"""Two processes run the tests in groups, so that what is dear is made once."""

from __future__ import annotations

import pytest


def test_a_module_is_a_group_of_pytest_xdist(request: pytest.FixtureRequest) -> None:
    if not getattr(request.config.option, "loadgroup", False):
        pytest.skip("one process runs everything")
    assert request.node.nodeid.endswith("@test_shared_fixtures")
