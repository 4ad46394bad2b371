"""Placeholders for custom agents whose code is not loaded, so that their results can still be read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NoReturn

from pydantic import ConfigDict, create_model

from trainables.agents.base import Hyperparameters
from trainables.errors import InputError

if TYPE_CHECKING:
    from trainables.agents.agent import Agent
from trainables.plugins.notes import _NOTES, needed_code


def missing_agent(name: str) -> Agent:
    """Return a placeholder for an agent of which only the name and the notes are known."""
    from trainables.agents.agent import Agent

    notes = _NOTES.get(name, {})
    fields: Any = {key: (Any, value) for key, value in notes.get("hyperparameters", {}).items()}
    made = create_model("Missing", __base__=_Anything, **fields)
    made.unwritten = notes.get("unwritten", {})

    def refuse(*_: object) -> NoReturn:
        raise InputError(needed_code("agent", name))

    kind = notes.get("kind", "deep")
    return Agent(name, notes.get("description", ""), made, notes.get("base"), refuse, kind, "missing")


class _Anything(Hyperparameters):
    model_config = ConfigDict(extra="allow", strict=False)
