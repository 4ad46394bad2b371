"""The update's benchmark: every row has a time, and a rate where it has arithmetic."""

from __future__ import annotations

from benchmarks.update_speed import DEAD, SHAPES, measure


def test_every_update_is_shown_beside_the_peak() -> None:
    result = measure(seconds=0.0, turns=1)
    assert result["fma_peak"]["share_of_peak"] == 1.0
    for task in SHAPES:
        assert result[f"{task}, adam alone"]["us"] > 0
        for dead in DEAD:
            assert result[f"{task}, dead {dead:g}"]["share_of_peak"] > 0
