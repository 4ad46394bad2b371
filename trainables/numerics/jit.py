"""Compilation of the tabular kernels by numba, with a disk cache that can never be stale.

numba's own cache looks at the file of the compiled function alone; a kernel that calls a function of another
file would go on running the old one after an upgrade. Here the cache folder is named by the contents of every
file that has kernels or a constant that one of them imports (numba freezes it into the kernel): a changed line in
any of these means a new compilation, and one elsewhere does not.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from platformdirs import user_cache_path

F = TypeVar("F", bound=Callable[..., object])

MAX_UNUSED_DAYS = 30
"""Days after which the kernels of a version that nobody has used are removed."""

_IMPORT = re.compile(r"^from trainables\.([\w.]+) import (\([^)]*\)|.*)$", re.MULTILINE)
_CONSTANT = re.compile(r"\b[A-Z][A-Z0-9_]+\b")


def _sources(package: Path) -> list[str]:
    """The text of every file below `package` that decides what its kernels compute."""
    texts = {file: file.read_text(encoding="utf-8") for file in sorted(package.rglob("*.py"))}
    kernels = {file for file, text in texts.items() if "compiled" in text or "numba" in text}
    frozen = {
        package.joinpath(*module.split(".")).with_suffix(".py")
        for file in kernels
        for module, names in _IMPORT.findall(texts[file])
        if _CONSTANT.search(names)
    }
    return [text for file, text in texts.items() if file in kernels | frozen]


@functools.cache
def _cache_folder() -> str | None:
    """A writable folder for compiled kernels, or None where there is none (then each process compiles)."""
    digest = hashlib.sha256()
    for source in _sources(Path(__file__).parents[1]):
        digest.update(source.encode())
    root = os.environ.get("NUMBA_CACHE_DIR") or str(user_cache_path("deltatune") / "kernels")
    folder = Path(root) / digest.hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        os.utime(folder)  # when it was used last
    except OSError:
        return None
    _remove_unused(folder)
    return str(folder)


def _remove_unused(folder: Path) -> None:
    """Remove the cache folders of other versions that no process has used for MAX_UNUSED_DAYS."""
    oldest = time.time() - 86400 * MAX_UNUSED_DAYS
    for other in folder.parent.iterdir():
        with contextlib.suppress(OSError):
            if re.fullmatch(r"[0-9a-f]{16}", other.name) and other.is_dir() and other.stat().st_mtime < oldest:
                shutil.rmtree(other, ignore_errors=True)


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
