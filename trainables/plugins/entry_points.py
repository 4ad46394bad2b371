"""Tasks and agents of installed packages, by the entry points `deltatune.tasks` and `deltatune.agents`."""

from __future__ import annotations

import functools
import sys
from collections.abc import Collection
from importlib.metadata import EntryPoint, entry_points
from typing import Any, Literal

from trainables.errors import InputError
from trainables.plugins import loader

Kind = Literal["task", "agent"]


@functools.cache
def _points(kind: Kind) -> tuple[EntryPoint, ...]:
    return tuple(entry_points(group=f"deltatune.{kind}s"))


def check_names(kind: Kind, taken: Collection[str]) -> None:
    """Raise InputError where a package takes a name that is `taken`, or that another package has."""
    owners = dict.fromkeys(taken, "deltatune itself")
    for point in _points(kind):
        package = f"the package '{_package(point)}'"
        if point.name in owners:
            raise InputError(
                f"{package} registers the {kind} '{point.name}', a name already taken by {owners[point.name]}: "
                "rename it there, or uninstall the package"
            )
        owners[point.name] = package


def names(kind: Kind) -> list[str]:
    """Return the names that packages have registered."""
    return [point.name for point in _points(kind)]


def find(kind: Kind, name: str) -> tuple[str, Any] | None:
    """Return (NAME@VERSION, the object registered as `name`), or None. Raises InputError if it cannot be imported."""
    point = next((point for point in _points(kind) if point.name == name), None)
    if point is None:
        return None
    try:
        found = point.load()
    except Exception as error:
        why = f"{type(error).__name__}: {error}"
        raise InputError(f"the {kind} '{name}' of '{_package(point)}' cannot be imported: {why}") from None
    loader.watch(str(getattr(sys.modules.get(point.module), "__file__", "")))
    version = point.dist.version if point.dist else "0"
    return f"{name}@{version}", found


def _package(point: EntryPoint) -> str:
    return point.dist.name if point.dist else point.module
