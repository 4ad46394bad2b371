"""Objects named as `module:Name`, so that heavy modules are imported only when they are needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def entry(named: Any) -> Any:
    """Return the object that the text `module:Name` names; anything else is returned as it is."""
    if not isinstance(named, str):
        return named
    module, _, name = named.partition(":")
    return getattr(import_module(module), name)
