"""The benchmark of the simulators names what it compares."""

from __future__ import annotations

from benchmarks.simulator_speed import compare


def test_a_row_says_which_environment_is_compiled_and_what_it_gains() -> None:
    row = compare("cartpole", 300)
    assert row["compiled"] == "True"
    assert float(row["step_us"]) < float(row["gymnasium_us"])
