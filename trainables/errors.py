"""The one error that a user's input can cause."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

from pydantic import ValidationError


class InputError(ValueError):
    """Bad input. Its text is one sentence that names the offending value and what is allowed."""


def unknown(what: str, name: str, known: Iterable[str]) -> InputError:
    """The error for a name that is not in a registry, with the nearest match and the list of what there is."""
    names = list(known)
    near = difflib.get_close_matches(name, names, n=1)
    hint = f"did you mean '{near[0]}'? " if near else ""
    return InputError(f"unknown {what} '{name}': {hint}there is {', '.join(names) or 'none'}")


def from_validation(where: str, error: ValidationError) -> InputError:
    """Turn pydantic's report into one sentence: the first offending field, what it may be, what it was."""
    first = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in first["loc"] if not str(part).startswith("function-"))
    subject = f"{where}: {place}" if place else where
    if first["type"] == "extra_forbidden":
        return InputError(f"{subject} is not a known key")
    if first["type"] == "missing":
        return InputError(f"{subject} is missing")
    rule = first["msg"][0].lower() + first["msg"][1:]
    rule = rule.removeprefix("value error, ").replace("input should be", "must be").replace("input should", "must")
    others = error.error_count() - 1
    more = f" (and {others} more)" if others else ""
    return InputError(f"{subject} {rule} (got {first['input']!r}){more}")
