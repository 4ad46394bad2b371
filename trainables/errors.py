"""The three kinds of errors: bad input, custom code or training, and infrastructure."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from pydantic import ValidationError


class InputError(ValueError):
    """Bad input. Its text is one sentence that names the offending value and what is allowed."""


class TrainingError(RuntimeError):
    """A cell cannot continue, since its agent or task returned an invalid value. The text says where and why."""


class InfrastructureError(RuntimeError):
    """A disk, network, process or cluster failed; neither the input nor custom code is wrong."""


_LONGEST_NAME = 200
"""Characters of a name that a message repeats."""


def unknown(what: str, name: str, known: Iterable[str]) -> InputError:
    """Return the error for a name that is not in a registry, with the nearest match and the list of names."""
    names = list(known)
    near = difflib.get_close_matches(name[:_LONGEST_NAME], names, n=1)
    hint = f"did you mean '{near[0]}'? " if near else ""
    name = name if len(name) <= _LONGEST_NAME else f"{name[:_SHOWN]}…"
    return InputError(f"unknown {what} '{name}': {hint}there is {', '.join(names) or 'none'}")


_SHOWN = 60
"""Characters of a value that a message repeats."""


def shown(value: object) -> str:
    """Return the beginning of a value in one line, for a message."""
    try:
        text = repr(value)
    except ValueError:  # a whole number of more than 4,300 digits
        return "a whole number of thousands of digits"
    size = f"{len(value):,} entries" if isinstance(value, list | tuple | dict) else f"{len(text):,} characters"
    return text if len(text) <= 2 * _SHOWN else f"{text[:_SHOWN]}… of {size}"


def one_line(text: str) -> str:
    """Return `text` in one line, with control characters and invalid characters escaped."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


_UNION_MEMBERS = ("float", "int", "str", "bool")
_RULES = {
    "too_short": "must not be empty",
    "tuple_type": "must be a list",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "int_parsing": "must be a whole number",
    "int_parsing_size": "must be a whole number of fewer digits",
    "float_parsing": "must be a number",
    "bool_parsing": "must be true or false",
    "dict_type": "must be a mapping of keys to values",
    "string_pattern_mismatch": "must be 1 to 64 letters, digits, dots, dashes or underscores, a letter or digit first",
}
"""Messages that replace those of pydantic which refer to Python."""


def from_validation(where: str, error: ValidationError) -> InputError:
    """Return pydantic's report as one sentence: the first wrong field, what is allowed, what was given."""
    first = error.errors(include_url=False)[0]
    place = ".".join(
        str(part) for part in first["loc"] if part not in _UNION_MEMBERS and not str(part).startswith("literal[")
    )
    subject = f"{where}: {place}" if place else where
    if first["type"] == "extra_forbidden":
        return InputError(f"{subject} is not a known key")
    if first["type"] == "missing":
        return InputError(f"{subject} is missing")
    if first["type"] == "too_long":
        most, got = first["ctx"]["max_length"], first["ctx"]["actual_length"]
        got = len(first["input"]) if got is None else got
        return InputError(f"{subject} must have at most {most:,} entries (got {got:,})")
    if first["type"] == "value_error":
        return InputError(f"{subject}{' ' if place else ': '}{first['ctx']['error']}")
    rule = _RULES.get(
        first["type"], first["msg"].replace("Input should", "must").replace("must be a valid", "must be a")
    )
    return InputError(f"{subject} {rule} (got {shown(first['input'])})")
