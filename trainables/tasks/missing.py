"""Placeholders for custom tasks whose code is not loaded, so that their results can still be read."""

from __future__ import annotations

import math
from typing import NoReturn

from trainables.errors import InputError
from trainables.plugins.notes import _NOTES, needed_code
from trainables.tasks.spec.family import ContextFeature, TaskFamily, split_features


def missing_family(name: str, features: str) -> TaskFamily:
    """Return a placeholder for a task family of which only the name and the notes are known."""

    def refuse(*_: object) -> NoReturn:
        raise InputError(needed_code("task", name))

    notes = _NOTES.get(name, {})
    parts = [part.partition("=")[::2] for part in split_features(features)]
    known = tuple(ContextFeature(key, math.nan, "", refuse, {value: value}) for key, value in parts)  # type: ignore[dict-item]
    model = refuse if notes.get("tabular") else None
    return TaskFamily(name, "", known, notes.get("defaults", {}), (), refuse, refuse, model, origin="missing")
