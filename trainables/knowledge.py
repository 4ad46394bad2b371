"""Source knowledge: what a trained agent has learned, as plain arrays."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trainables.errors import InputError

META = "meta"
"""Name of the array with a file's JSON header."""


MAX_BYTES = 2**30
"""Largest unpacked size of a file that is read."""


@dataclass(frozen=True)
class Knowledge:
    """Named arrays, e.g. {"q": (S, A) float64} for a table."""

    arrays: Mapping[str, NDArray[Any]]

    @property
    def digest(self) -> str:
        """Return the SHA-256 over names, types, shapes and bytes; equal iff every bit is."""
        digest = hashlib.sha256()
        for name in sorted(self.arrays):
            array = np.ascontiguousarray(self.arrays[name])
            digest.update(f"{name}:{array.dtype.str}:{array.shape};".encode())
            digest.update(array.tobytes())
        return digest.hexdigest()

    def q_table(self, shape: tuple[int, int]) -> NDArray[np.float64]:
        """Return the table (S, A). Raises InputError where there is none, it is not finite, or has another shape."""
        q = self.arrays.get("q")
        if q is None or q.dtype != np.float64:
            raise InputError("the source is not a Q table of 64-bit floats")
        if q.shape != shape:
            raise InputError(f"the source's Q table has shape {q.shape}, but the target task needs {shape}")
        if not np.isfinite(q).all():
            raise InputError("the source's Q table holds a NaN or an infinity")
        return q

    def to_bytes(self, meta: Mapping[str, Any] | None = None) -> bytes:
        """Return an .npz file without pickled objects, with `meta` and the digest in its header."""
        header = json.dumps({"schema": 1, "digest": self.digest, **(meta or {})}).encode()
        stream = io.BytesIO()
        arrays: dict[str, Any] = {META: np.frombuffer(header, np.uint8), **self.arrays}
        np.savez_compressed(stream, allow_pickle=False, **arrays)
        return stream.getvalue()

    @classmethod
    def from_bytes(cls, data: bytes) -> tuple[Knowledge, dict[str, Any]]:
        """Return (knowledge, header) from the bytes of `to_bytes`. Raises InputError for anything else."""
        try:
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                size = sum(info.file_size for info in archive.infolist())
            if size > MAX_BYTES:
                raise ValueError(f"it unpacks to {size} bytes, more than {MAX_BYTES}")
            with np.load(io.BytesIO(data), allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files}
            meta = json.loads(arrays.pop(META).tobytes())
        except Exception as error:  # a damaged archive may raise anything: zlib.error, BadZipFile, KeyError, ...
            raise InputError(f"not a file of source knowledge ({error})") from None
        knowledge = cls(arrays)
        if not isinstance(meta, dict) or meta.get("schema") != 1 or meta.get("digest") != knowledge.digest:
            raise InputError("its arrays do not agree with its checksum")
        return knowledge, meta


def joined(several: Sequence[Knowledge]) -> Knowledge:
    """Return the knowledge of several sources as one, array `name` of source i as `i/name`; a single one unchanged."""
    if len(several) == 1:
        return several[0]
    return Knowledge({f"{i}/{name}": array for i, each in enumerate(several) for name, array in each.arrays.items()})


def parts(knowledge: Knowledge, count: int) -> list[Knowledge]:
    """Return the `count` pieces of knowledge that `joined` has joined."""
    if count == 1:
        return [knowledge]
    found: list[dict[str, NDArray[Any]]] = [{} for _ in range(count)]
    for key, array in knowledge.arrays.items():
        number, _, name = key.partition("/")
        if not number.isdigit() or int(number) >= count:
            raise InputError(f"the knowledge is not that of {count} sources")
        found[int(number)][name] = array
    return [Knowledge(arrays) for arrays in found]
