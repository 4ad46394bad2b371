"""A checkpoint is whole or it is nothing."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trainables.storage import checkpoint

STATE = {
    "array": np.arange(6, dtype=np.float32).reshape(2, 3),
    "flags": np.array([True, False]),
    "nested": {"rng": np.random.default_rng(0).bit_generator.state, "list": [1, 2.5, None, "text"]},
    "minus_infinity": float("-inf"),
    "empty": {},
    "number": np.int64(7),
}


def equal(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and np.array_equal(a, b)
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(equal(a[key], b[key]) for key in a)
    return bool(a == b)


def test_what_is_saved_is_what_is_loaded(tmp_path: Path) -> None:
    path = tmp_path / "new" / "state"
    checkpoint.save(path, STATE)
    assert equal(checkpoint.load(path), STATE)
    checkpoint.save(path, {"other": 1})
    assert checkpoint.load(path) == {"other": 1}
    assert [entry.name for entry in path.parent.iterdir()] == ["state"]


@settings(max_examples=50, deadline=None)
@given(keep=st.floats(0, 0.999), flip=st.booleans())
def test_a_torn_or_damaged_file_is_never_taken_for_a_whole_one(
    keep: float, flip: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("torn") / "state"
    checkpoint.save(path, STATE)
    data = bytearray(path.read_bytes())
    at = int(keep * len(data))
    if flip:
        data[at] ^= 1
    else:
        del data[at:]
    path.write_bytes(data)
    assert checkpoint.load_if_whole(path) is None
    with pytest.raises(checkpoint.CheckpointError):
        checkpoint.load(path)


def test_no_file_is_no_checkpoint(tmp_path: Path) -> None:
    assert checkpoint.load_if_whole(tmp_path / "none") is None


def test_a_crash_while_writing_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "state"
    checkpoint.save(path, {"old": 1})

    def crash(descriptor: int) -> None:
        raise OSError("no space")

    monkeypatch.setattr(os, "fsync", crash)
    with pytest.raises(OSError, match="no space"):
        checkpoint.save(path, {"new": 2})
    assert checkpoint.load(path) == {"old": 1}
    assert [entry.name for entry in tmp_path.iterdir()] == ["state"]
