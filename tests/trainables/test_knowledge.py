"""Source knowledge as a file: what comes back is what was written, or nothing."""

from __future__ import annotations

import contextlib
import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from trainables.errors import InputError
from trainables.knowledge import Knowledge

tables = hnp.arrays(np.float64, hnp.array_shapes(min_dims=1, max_dims=3, max_side=4))
SAMPLE = Knowledge({"q": np.arange(40.0).reshape(20, 2), "steps": np.array([3])})
FILE = SAMPLE.to_bytes({"cell": {"agent": "q_learning"}})


@settings(deadline=None)
@given(st.dictionaries(st.sampled_from(["q", "weights", "delta"]), tables, min_size=1))
def test_arrays_come_back_bit_for_bit(arrays) -> None:
    knowledge = Knowledge(arrays)
    again, meta = Knowledge.from_bytes(knowledge.to_bytes({"cell": 1}))
    assert set(again.arrays) == set(arrays)
    assert all(again.arrays[name].tobytes() == arrays[name].tobytes() for name in arrays)
    assert all(again.arrays[name].shape == arrays[name].shape for name in arrays)
    assert again.digest == knowledge.digest
    assert meta["cell"] == 1


@settings(deadline=None)
@given(st.integers(0, len(FILE) - 1), st.integers(1, 255))
def test_a_file_with_one_altered_byte_is_refused_or_says_the_same(position: int, flip: int) -> None:
    # A zip has bytes that mean nothing to us, such as the time of day; no other may change unseen.
    damaged = bytearray(FILE)
    damaged[position] ^= flip
    with contextlib.suppress(InputError):
        knowledge, meta = Knowledge.from_bytes(bytes(damaged))
        assert knowledge.digest == SAMPLE.digest
        assert meta["cell"] == {"agent": "q_learning"}


def test_every_altered_byte_of_the_arrays_is_refused() -> None:
    # Stored without compression, every byte of the table can be found and altered.
    plain = io.BytesIO()
    arrays, meta = Knowledge.from_bytes(FILE)[0].arrays, np.load(io.BytesIO(FILE))["meta"]
    np.savez(plain, meta=meta, **arrays)
    data = plain.getvalue()
    start = data.index(SAMPLE.arrays["q"].tobytes())
    for position in range(start, start + SAMPLE.arrays["q"].nbytes):
        with pytest.raises(InputError):
            Knowledge.from_bytes(data[:position] + bytes([data[position] ^ 1]) + data[position + 1 :])


@settings(deadline=None)
@given(st.integers(0, len(FILE) - 1))
def test_a_file_that_was_cut_short_is_refused(length: int) -> None:
    with pytest.raises(InputError):
        Knowledge.from_bytes(FILE[:length])


def test_an_altered_value_with_a_good_zip_checksum_is_refused() -> None:
    with np.load(io.BytesIO(FILE)) as file:
        arrays = {name: file[name] for name in file.files}
    arrays["q"][3, 1] = np.nextafter(arrays["q"][3, 1], np.inf)
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    with pytest.raises(InputError, match="do not agree with its checksum"):
        Knowledge.from_bytes(stream.getvalue())


def test_a_small_file_that_unpacks_to_more_than_the_limit_is_refused(monkeypatch) -> None:
    data = Knowledge({"q": np.zeros((1000, 100))}).to_bytes()
    assert len(data) < 10_000
    monkeypatch.setattr("trainables.knowledge.MAX_BYTES", 100_000)
    with pytest.raises(InputError, match=r"unpacks to 80\d{4} bytes, more than 100000"):
        Knowledge.from_bytes(data)


class _Trap:
    """An object whose unpickling would be noticed."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return pytest.fail, ("a pickle was read",)


def test_pickled_arrays_are_refused_unread() -> None:
    stream = io.BytesIO()
    np.savez(stream, q=np.array([_Trap()], dtype=object), meta=np.zeros(1, np.uint8))
    with pytest.raises(InputError, match="not a file of source knowledge"):
        Knowledge.from_bytes(stream.getvalue())
    with pytest.raises(ValueError, match=r"[Oo]bject arrays"):
        Knowledge({"q": np.array([_Trap()], dtype=object)}).to_bytes()


@pytest.mark.parametrize("data", [b"", b"not a zip", b"PK\x03\x04", b"\x93NUMPY\x01\x00", b"\x80\x04K\x01."])
def test_other_files_are_refused(data: bytes) -> None:
    with pytest.raises(InputError, match="not a file of source knowledge"):
        Knowledge.from_bytes(data)


def test_the_digest_sees_names_types_shapes_and_every_bit() -> None:
    q = np.zeros((2, 3))
    digests = {
        Knowledge({"q": q}).digest,
        Knowledge({"p": q}).digest,
        Knowledge({"q": q.reshape(3, 2)}).digest,
        Knowledge({"q": q.astype(np.float32)}).digest,
        Knowledge({"q": q.view(np.int64)}).digest,
        Knowledge({"q": np.full((2, 3), -0.0)}).digest,
        Knowledge({"q": q, "p": q}).digest,
    }
    assert len(digests) == 7
    assert Knowledge({"q": np.asfortranarray(np.arange(6.0).reshape(2, 3))}).digest == (
        Knowledge({"q": np.arange(6.0).reshape(2, 3)}).digest
    )
