"""The names of custom tasks and agents.

FILE.py:NAME[:FEATURE=VALUE,...]          as users write it
FILE.py@PIN:NAME[:FEATURE=VALUE,...]      canonical, in cells: the file's name without folder, a hash of its content
NAME@VERSION[:FEATURE=VALUE,...]          canonical, of an installed package with its version
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from trainables.errors import InputError

_FILE = re.compile(
    r"(?P<folder>(?:[^:]*/)?)(?P<file>[\w.-]+\.py)(?:@(?P<pin>[0-9a-f]{8}))?:(?P<attribute>[A-Za-z_]\w*)(?::(?P<rest>.*))?"
)
_PACKAGE = re.compile(r"(?P<name>[A-Za-z_]\w*)@(?P<version>[\w.+!-]+)")


@dataclass(frozen=True)
class FileName:
    """The parts of a name by file."""

    path: Path
    pin: str
    """Empty where none is given."""
    attribute: str
    rest: str
    """The features as text."""

    def pinned(self, pin: str) -> str:
        """Return the canonical name, features included."""
        return f"{self.path.name}@{pin}:{self.attribute}" + (f":{self.rest}" if self.rest else "")


def by_file(text: str) -> bool:
    """Return whether `text` names custom code by its file."""
    return re.match(r"[^:]*\.py(@[^:]*)?(:|$)", text) is not None


def file_name(text: str) -> FileName:
    """Return the parts of a name by file. Raises InputError for other text."""
    match = _FILE.fullmatch(text)
    if match is None:
        raise InputError(
            f"'{text}' is not FILE.py:NAME (a file of letters, digits, dots and dashes, then a name in it)"
        )
    path = Path(match["folder"] + match["file"])
    return FileName(path, match["pin"] or "", match["attribute"], match["rest"] or "")


def package_name(text: str) -> tuple[str, str]:
    """Return (name, version) of 'NAME@VERSION'; the version may be empty."""
    match = _PACKAGE.fullmatch(text)
    return (match["name"], match["version"]) if match else (text, "")


def short(text: str) -> str:
    """Return `text` with every name of custom code as users write it, without pins."""
    return re.sub(r"(?<=\.py)@[0-9a-f]{8}(?=:)", "", text)


def is_custom(text: str) -> bool:
    """Return whether `text`, with or without features, is a canonical name of custom code, by file or by package."""
    return by_file(text) or _PACKAGE.fullmatch(text.partition(":")[0]) is not None


def described(thing: object) -> str:
    """Return a short description of a value: 'an agent', 'the class Walk', '3', 'a value of the type Env'."""
    kind = type(thing).__name__
    if isinstance(thing, type):
        return f"the class {thing.__name__}"
    if isinstance(thing, int | float | str | None):
        return repr(thing)
    return {"Agent": "an agent", "TaskFamily": "a task"}.get(kind, f"a value of the type {kind}")
