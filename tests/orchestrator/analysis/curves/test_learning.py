"""What learned nothing is named."""

from __future__ import annotations

import pandas as pd
import pytest

from orchestrator.analysis.curves.learning import learned_nothing, nothing_in


@pytest.mark.parametrize(
    ("returns", "said"),
    [
        ([-200.0, -200.0, -200.0], "learned nothing: its greedy return never left -200"),
        ([-200.0, -199.99999999999, -200.0], "learned nothing: its greedy return never left -200"),
        ([-200.0, -150.0, -200.0], None),
        ([-200.0, -210.0], None),
        ([-200.0], None),
    ],
)
def test_a_curve_that_never_left_its_first_value_is_named(returns: list[float], said: str | None) -> None:
    assert learned_nothing(returns) == said


def test_a_configuration_learned_nothing_where_no_seed_did() -> None:
    flat = {"initial_return": -200.0, "best_return": -200.0, "final_return": -200.0, "auc": -200.0}
    assert nothing_in(pd.DataFrame([flat, flat])) == "learned nothing: its greedy return never left -200"
    assert nothing_in(pd.DataFrame([flat, flat | {"best_return": -90.0, "auc": -180.0}])) is None
    assert nothing_in(pd.DataFrame([flat]).drop(columns="best_return")) is None
