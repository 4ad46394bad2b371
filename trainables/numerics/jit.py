"""Compilation of kernels by numba, with a disk cache that is never stale.

numba's cache only checks the file of the compiled function; a kernel that calls a function in another file would use
the old one after an upgrade. Here the name of the cache folder is a hash of every file that has kernels, or a constant
that a kernel imports (numba freezes it into the kernel): a change in one of these compiles everything again, and a
change elsewhere nothing. In that folder a kernel is identified by its path within the package, so that another copy
with the same content (a second clone, the code of a job) compiles nothing.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import logging
import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba.core import event
from platformdirs import user_cache_path

F = TypeVar("F", bound=Callable[..., object])

log = logging.getLogger("deltatune.numerics")

MAX_UNUSED_DAYS = 30
"""Days after which unused kernels of another version are removed."""

_IMPORT = re.compile(r"^from trainables\.([\w.]+) import (\([^)]*\)|.*)$", re.MULTILINE)
_CONSTANT = re.compile(r"\b[A-Z][A-Z0-9_]+\b")


def _sources(package: Path) -> list[str]:
    """Return the text of every file below `package` on which its kernels depend."""
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
    """Return a writable folder for compiled kernels, or None, where each process then compiles."""
    digest = hashlib.sha256()
    for source in _sources(Path(__file__).parents[1]):
        digest.update(source.encode())
    root = os.environ.get("NUMBA_CACHE_DIR") or str(user_cache_path("deltatune") / "kernels")
    folder = Path(root) / digest.hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        os.utime(folder)  # marks it as used now
    except OSError as error:
        log.info("compiled kernels are not kept: %s", error)
        return None
    _remove_unused(folder)
    return str(folder)


def _remove_unused(folder: Path) -> None:
    """Remove the cache folders of other versions that were not used for MAX_UNUSED_DAYS."""
    oldest = time.time() - 86400 * MAX_UNUSED_DAYS
    for other in folder.parent.iterdir():
        with contextlib.suppress(OSError):
            if re.fullmatch(r"[0-9a-f]{16}", other.name) and other.is_dir() and other.stat().st_mtime < oldest:
                shutil.rmtree(other, ignore_errors=True)


class Place:
    """Where the kernels of a file are cached, as numba requires: by the file's path in the package, not on the disk."""

    def __init__(self, folder: str, file: Path, line: int) -> None:
        package = Path(__file__).parents[1]
        inside = file.is_relative_to(package)
        name = ".".join(file.relative_to(package).parts[:-1]) if inside else _digest(str(file.parent).encode())
        self._path, self._py_file, self._line = Path(folder, name), file, line

    @classmethod
    def from_function(cls, function: Callable[..., object], file: str) -> Place | None:
        """Return the place of `function`, or None: then numba has its own ways."""
        folder, path = _cache_folder(), Path(file).absolute()
        return cls(folder, path, function.__code__.co_firstlineno) if folder is not None and path.is_file() else None

    def ensure_cache_path(self) -> None:
        """Make the folder."""
        self._path.mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        """Return the folder of the cached kernels."""
        return str(self._path)

    def get_source_stamp(self) -> str:
        """Return what a cached kernel must bear to be fresh: the digest of its file."""
        return _digest(self._py_file.read_bytes())

    def get_disambiguator(self) -> str:
        """Return what distinguishes two functions of one name in one file."""
        return str(self._line)


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def compiled(function: F) -> F:
    """Return `function` compiled without fast-math, with the same bits as the plain Python function.

    With NUMBA_DISABLE_JIT=1 the plain function itself runs, against which the tests compare.
    """
    config: Any = numba.config
    before = config.CACHE_LOCATOR_CLASSES
    config.CACHE_LOCATOR_CLASSES = f"{__name__}.{Place.__name__}"
    try:
        result: Any = numba.njit(cache=_cache_folder() is not None)(function)
        return cast("F", result)
    finally:
        config.CACHE_LOCATOR_CLASSES = before


class _Begun(event.Listener):
    """Calls `tell` when the first kernel is compiled."""

    def __init__(self, tell: Callable[[], None]) -> None:
        self._tell: Callable[[], None] | None = tell

    def on_start(self, event: object) -> None:
        tell, self._tell = self._tell, None
        if tell is not None:
            tell()

    def on_end(self, event: object) -> None:
        pass


@contextlib.contextmanager
def on_compilation(tell: Callable[[], None]) -> Iterator[None]:
    """Call `tell` once if a kernel is compiled in the block, when that begins; one from the cache does not count."""
    with event.install_listener("numba:compile", _Begun(tell)):
        yield
