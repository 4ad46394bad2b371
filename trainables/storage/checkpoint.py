"""Checkpoint files: arrays and plain data without pickle, with a checksum that detects incomplete files."""

from __future__ import annotations

import hashlib
import io
import json
import logging
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trainables.errors import InfrastructureError
from trainables.storage.atomic import write_atomic
from trainables.storage.paths import is_local, read_range

log = logging.getLogger("deltatune.training")

MAGIC = b"deltatune checkpoint 1\n"
COMPRESSED = b"deltatune checkpoint 1 zlib\n"
"""How files begin, those that `packed` has made the second."""


class CheckpointError(InfrastructureError):
    """A file is no complete checkpoint. The text says which and why."""


def save(path: Path, state: Mapping[str, Any]) -> None:
    """Write `state` (nested mappings of arrays, numbers, texts, None and lists of them) to `path` atomically."""
    payload = _payload(state)
    write(path, MAGIC + hashlib.sha256(payload).digest() + payload)


def packed(state: Mapping[str, Any]) -> bytes:
    """Return what `save` would write, compressed: a hundredth for large tables, two thirds for networks."""
    payload = zlib.compress(_payload(state), 1)
    return COMPRESSED + hashlib.sha256(payload).digest() + payload


def write(path: Path, data: bytes, durable: bool = True) -> None:
    """Write a file atomically (see `write_atomic`), and its folder where it is missing."""
    if is_local(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, data, durable)


def _payload(state: Mapping[str, Any]) -> bytes:
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    tree = json.dumps(_split(state, arrays), allow_nan=True)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **{f"a{number}": array for number, array in enumerate(arrays.values())})
    text = tree.encode()
    return len(text).to_bytes(8, "big") + text + buffer.getvalue()


def load(path: Path) -> dict[str, Any]:
    """Return the state that `save` or `packed` wrote.

    Raises CheckpointError for an invalid file, FileNotFoundError for none.
    """
    data = read_range(path)
    magic = next((magic for magic in (MAGIC, COMPRESSED) if data.startswith(magic)), None)
    if magic is None:
        raise CheckpointError(f"{path} is not a checkpoint of this version")
    start = len(magic) + 32
    payload = data[start:]
    if hashlib.sha256(payload).digest() != data[len(magic) : start]:
        raise CheckpointError(f"{path} is damaged or was not written to its end")
    if magic == COMPRESSED:
        payload = zlib.decompress(payload)
    length = 8 + int.from_bytes(payload[:8], "big")
    tree = json.loads(payload[8:length])
    with np.load(io.BytesIO(payload[length:]), allow_pickle=False) as archive:
        joined: dict[str, Any] = _join(tree, archive)
    return joined


def load_if_whole(path: Path) -> dict[str, Any] | None:
    """Return the state at `path`, or None where there is no complete checkpoint. A damaged one is logged."""
    try:
        return load(path)
    except FileNotFoundError:
        return None
    except (CheckpointError, zipfile.BadZipFile) as error:
        log.warning("%s: the cell starts again", error)
        return None


def _split(value: Any, arrays: dict[str, np.ndarray[Any, Any]]) -> Any:
    """Return plain data with each array replaced by its number."""
    if isinstance(value, np.ndarray):
        name = str(len(arrays))
        arrays[name] = value
        return {"array": int(name)}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return {"mapping": {key: _split(item, arrays) for key, item in value.items()}}
    if isinstance(value, list | tuple):
        return {"list": [_split(item, arrays) for item in value]}
    return value


def _join(tree: Any, archive: Mapping[str, Any]) -> Any:
    if not isinstance(tree, dict):
        return tree
    if "array" in tree:
        return archive[f"a{tree['array']}"]
    if "list" in tree:
        return [_join(item, archive) for item in tree["list"]]
    return {key: _join(item, archive) for key, item in tree["mapping"].items()}
