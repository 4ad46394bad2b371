"""Custom files loaded in this process, by content hash.

A file runs only if the user names it: on the command line, in a search space, or by `deltatune.load_custom`. A name in
a record, or in other data that is read, never loads a file.
"""

from __future__ import annotations

import difflib
import hashlib
import linecache
import sys
import traceback
import types
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from trainables.errors import InputError
from trainables.plugins.names import FileName, by_file, described, file_name, short
from trainables.storage.files import read_file
from trainables.storage.paths import is_file

Made = TypeVar("Made")

MAX_BYTES = 10 * 2**20
"""Size of a file of custom code."""


class CustomCodeError(RuntimeError):
    """Custom code violates its interface. The text is one sentence, with the file and the line."""


@dataclass(frozen=True)
class Loaded:
    """A file that has been run as a module."""

    source: bytes
    module: types.ModuleType


_LOADED: dict[str, Loaded] = {}
"""By 'FILE.py@PIN'."""
BROKEN: dict[str, str] = {}
"""Why a file that was shipped here could not be run, by 'FILE.py@PIN'."""
_PLACES: set[str] = set()
"""The `co_filename` of custom code, that of installed packages included."""


def pin_of(source: bytes) -> str:
    """Return the hash of a file's content as it is in names; line endings are ignored."""
    return hashlib.sha256(source.replace(b"\r\n", b"\n")).hexdigest()[:8]


def canonicalise(name: str, folders: Iterable[Path] = (Path(),)) -> str:
    """Return the canonical name of a task or agent that the user has named; the file of a custom one is run.

    folders: where a relative path is looked for, in order. Raises InputError as `pin` does.
    """
    return pin(name, folders) if by_file(name) else name


def pin(text: str, folders: Iterable[Path] = (Path(),)) -> str:
    """Load the file that `text` names and return the canonical name, features included.

    folders: where a relative path is looked for, in order; a file that is in none of them may be loaded already.
    Raises InputError where the file is missing, cannot be run, or has another content than the pin in `text`.
    """
    name = file_name(text)
    path = next((folder / name.path for folder in folders if is_file(folder / name.path)), None)
    loaded = others(name.path.name) if path is None and name.path.name == str(name.path) else []
    if name.pin in loaded or (len(loaded) == 1 and not name.pin):
        return name.pinned(name.pin or loaded[0])
    return name.pinned(load_file(path or name.path, name.pin))


def load_file(path: str | Path, expected: str = "") -> str:
    """Run a file, unless it was run already, and return its pin. Raises InputError as `pin` does."""
    path = Path(path)
    source = read_file(path, MAX_BYTES)
    found = pin_of(source)
    if expected not in ("", found):
        raise InputError(f"{path} is no longer the file that was used: it is {path.name}@{found}, not @{expected}")
    _run(f"{path.name}@{found}", source, str(path.absolute()))
    return found


def others(file: str) -> list[str]:
    """Return the pins of the loaded files with this name."""
    return [key.partition("@")[2] for key in _LOADED if key.partition("@")[0] == file]


def attribute(name: FileName) -> Any:
    """Return the object of a pinned name; None if its file is not loaded. Raises InputError if the file lacks it."""
    loaded = _LOADED.get(f"{name.path.name}@{name.pin}")
    if loaded is None:
        return None
    if not hasattr(loaded.module, name.attribute):
        there = _names(loaded.module)
        near = difflib.get_close_matches(name.attribute, there, n=1)
        hint = f"; did you mean '{near[0]}'?" if near else f": there is {', '.join(there) or 'none'}"
        raise InputError(f"{name.path.name} has no '{name.attribute}'{hint}")
    return getattr(loaded.module, name.attribute)


def _names(module: types.ModuleType) -> list[str]:
    """Return the public names that a file defines, without the modules, classes and functions that it imports."""

    def imported(value: object) -> bool:
        code = isinstance(value, (type, types.FunctionType)) and value.__module__ != module.__name__
        return code or isinstance(value, types.ModuleType) or type(value).__module__ == "__future__"

    return [name for name, value in vars(module).items() if not name.startswith("_") and not imported(value)]


def instance(name: str, thing: Any, kind: type[Made], word: str) -> Made:
    """Return `thing`, or the result of calling it. Raises InputError unless that is a `kind`, named `word`."""
    if callable(thing) and not isinstance(thing, (type, kind)):
        try:
            thing = thing()
        except Exception as error:
            raise InputError(f"{name} is not {word}: calling it failed ({describe_error(error)})") from None
    if not isinstance(thing, kind):
        maker = word.split()[-1]
        raise InputError(f"{short(name)} is not {word} (it is {described(thing)}): make one with deltatune.{maker}")
    return thing


def packed() -> dict[str, bytes]:
    """Return every loaded file by 'FILE.py@PIN', for shipping to workers."""
    return {key: loaded.source for key, loaded in _LOADED.items()}


def install(files: Mapping[str, bytes]) -> None:
    """Load the files that `packed` returned on another machine. Nothing is written to disk.

    A file that does not run here, for instance without a package, only fails the cells that need it.
    Raises InputError for a content that does not match the pin.
    """
    for key, source in files.items():
        if key != f"{key.partition('@')[0]}@{pin_of(source)}":
            raise InputError(f"{key} arrived with another content (@{pin_of(source)})")
        try:
            _run(key, source, key.partition("@")[0])
        except InputError as error:
            BROKEN[key] = str(error)


def watch(place: str) -> None:
    """Treat code in the file `place` as custom code in error messages."""
    _PLACES.add(place)


def is_custom(place: str) -> bool:
    """Return whether the code in the file `place` is custom code."""
    return place in _PLACES


def describe_error(exception: BaseException) -> str:
    """Return an error as one sentence, with the innermost line of custom code, else the innermost line of all."""
    if isinstance(exception, CustomCodeError):
        return str(exception)
    frames = traceback.extract_tb(exception.__traceback__)
    where = next((frame for frame in reversed(frames) if is_custom(frame.filename)), frames[-1])
    text = " ".join(str(exception).split())
    return f"{type(exception).__name__}: {text} ({Path(where.filename).name}:{where.lineno})"


def _run(key: str, source: bytes, place: str) -> None:
    """Run a file as a new module, unless it is loaded."""
    if key in _LOADED:
        return
    file, _, digest = key.partition("@")
    module = types.ModuleType(
        f"deltatune_custom_{digest}_{file.removesuffix('.py').replace('.', '_').replace('-', '_')}"
    )
    module.__file__ = place
    text = source.decode("utf-8-sig", errors="replace")
    linecache.cache[place] = (len(text), None, text.splitlines(keepends=True), place)  # for tracebacks and `inspect`
    _PLACES.add(place)
    sys.modules[module.__name__] = module
    try:
        exec(compile(source, place, "exec"), module.__dict__)
    except SyntaxError as error:
        del sys.modules[module.__name__]
        raise InputError(f"{file}:{error.lineno}: not Python ({error.msg})") from None
    except Exception as error:
        del sys.modules[module.__name__]
        if isinstance(error, InputError):
            raise InputError(f"{_line(error, place, file)}: {error}") from None
        raise InputError(f"{_line(error, place, file)}: {type(error).__name__}: {error}") from None
    _LOADED[key] = Loaded(source, module)


def _line(error: Exception, place: str, file: str) -> str:
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == place]
    return f"{file}:{lines[-1]}" if lines else file
