"""Custom task families by their canonical names."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from trainables.errors import InputError
from trainables.plugins import entry_points, loader, names
from trainables.tasks.spec.family import TaskFamily


def family(text: str) -> tuple[TaskFamily, str]:
    """Return the family that `text` names, and the text of its features; a placeholder where the code is missing.

    Raises InputError for a file that is not loaded, and for an object that is no task.
    """
    from trainables.tasks.missing import missing_family

    if not names.by_file(text):
        code, _, features = text.partition(":")
        found = installed_family(names.package_name(code)[0])
        return found if found and found.name == code else missing_family(code, features), features
    name = names.file_name(text)
    code = f"{name.path.name}@{name.pin}:{name.attribute}"
    if not name.pin:
        raise InputError(f"'{text}' names a file that is not loaded: call deltatune.load_custom with this name first")
    thing = loader.attribute(name)
    return (missing_family(code, name.rest) if thing is None else _family(code, thing)), name.rest


def installed_family(name: str) -> TaskFamily | None:
    """Return the task that an installed package registers as `name`, under the name NAME@VERSION; or None."""
    found = entry_points.find("task", name)
    return _family(*found) if found else None


_FAMILIES: dict[str, TaskFamily] = {}
"""By canonical name, which identifies the content."""


def _family(name: str, thing: Any) -> TaskFamily:
    if name in _FAMILIES:
        return _FAMILIES[name]
    made = loader.instance(name, thing, TaskFamily, "a task")
    targets = tuple(f"{name}:{target}" for target in made.targets)
    return _FAMILIES.setdefault(name, replace(made, name=name, targets=targets, origin="custom"))
