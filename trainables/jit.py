"""Compilation of the tabular kernels by numba, with a disk cache that can never be stale.

numba's own cache looks at the file of the compiled function alone; a kernel that calls a function of another
file would go on running the old one after an upgrade. Here the cache folder is named by the contents of every
kernel file, so a changed line anywhere means a new compilation.
"""

from __future__ import annotations

import functools
import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from platformdirs import user_cache_path

F = TypeVar("F", bound=Callable[..., object])


@functools.cache
def _cache_folder() -> str | None:
    """A writable folder for compiled kernels, or None where there is none (then each process compiles)."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(file.read_bytes())
    root = os.environ.get("NUMBA_CACHE_DIR") or str(user_cache_path("deltatune") / "kernels")
    folder = Path(root) / digest.hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return str(folder)
    except OSError:
        return None


def compiled(function: F) -> F:
    """Compile `function` without fast-math: the same bits as the plain Python function.

    With NUMBA_DISABLE_JIT=1 the plain function itself runs, which is the oracle of the tests.
    """
    folder = _cache_folder()
    config: Any = numba.config
    before = config.CACHE_DIR
    config.CACHE_DIR = folder or before
    try:
        result: Any = numba.njit(cache=folder is not None)(function)
        return cast("F", result)
    finally:
        config.CACHE_DIR = before
