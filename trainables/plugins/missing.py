"""Stand-ins for own tasks and agents whose code is not loaded, so that what they left can still be read.

What is known of them comes from the sweep's own notes (`remember`); nothing of them can be run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NoReturn

from pydantic import ConfigDict, create_model

from trainables.agents.hyperparameters import Hyperparameters
from trainables.errors import InputError
from trainables.plugins.files import BROKEN, others
from trainables.plugins.names import by_file
from trainables.tasks.task import ContextFeature, TaskFamily, split_features

if TYPE_CHECKING:
    from trainables.agents import Agent

_NOTES: dict[str, Mapping[str, Any]] = {}
"""What is known of own code, by canonical name."""


def note(thing: TaskFamily | Agent) -> dict[str, Any]:
    """What has to be known of own code to read its results without it, as plain data."""
    if isinstance(thing, TaskFamily):
        return {"tabular": thing.model is not None, "defaults": dict(thing.defaults)}
    fields = thing.hyperparameters.model_fields
    defaults = {name: None if field.is_required() else field.default for name, field in fields.items()}
    return {"base": thing.base, "kind": thing.kind, "description": thing.description, "hyperparameters": defaults}


def remember(notes: Mapping[str, Mapping[str, Any]]) -> None:
    """Keep notes that `note` made, by canonical name."""
    _NOTES.update(notes)


def missing_family(name: str, features: str) -> TaskFamily:
    """A task family of which nothing but its name and its notes is known."""

    def refuse(*_: object) -> NoReturn:
        raise InputError(_sentence("task", name))

    notes = _NOTES.get(name, {})
    parts = [part.partition("=")[::2] for part in split_features(features)]
    known = tuple(ContextFeature(key, math.nan, "", refuse, {value: value}) for key, value in parts)  # type: ignore[dict-item]
    model = refuse if notes.get("tabular") else None
    return TaskFamily(name, "", known, notes.get("defaults", {}), (), refuse, refuse, model, origin="missing")


def missing_agent(name: str) -> Agent:
    """An agent of which nothing but its name and its notes is known."""
    from trainables.agents import Agent

    notes = _NOTES.get(name, {})
    fields: Any = {key: (Any, value) for key, value in notes.get("hyperparameters", {}).items()}
    made = create_model("Missing", __base__=_Anything, **fields)

    def refuse(*_: object) -> NoReturn:
        raise InputError(_sentence("agent", name))

    kind = notes.get("kind", "deep")
    return Agent(name, notes.get("description", ""), made, notes.get("base"), refuse, kind, "missing")


class _Anything(Hyperparameters):
    model_config = ConfigDict(extra="allow", strict=False)


def _sentence(kind: str, name: str) -> str:
    code, _, _ = name.partition(":")
    file, _, pin = code.partition("@")
    if code in BROKEN:
        return f"the {kind} {name} cannot be loaded here ({BROKEN[code]})"
    if by_file(name) and others(file):
        return f"the {kind} {name} is of another {file}: the file is @{others(file)[0]} now, it was @{pin} then"
    if by_file(name):
        return f"the {kind} {name} needs {file} as it was then (@{pin}): name that file, e.g. with --file {file}"
    return f"the {kind} {name} needs the package that registers '{file}' in version {pin}, which is not installed here"
