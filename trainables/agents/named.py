"""Things that are named by text, so that nothing heavy is imported before it is needed."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def entry(named: Any) -> Any:
    """Return what the text `module:Name` names, or `named` itself where it is no text."""
    if not isinstance(named, str):
        return named
    module, _, name = named.partition(":")
    return getattr(import_module(module), name)
