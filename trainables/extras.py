"""The extras of the package: libraries that some tasks, agents and commands need, and others do not."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass

from trainables.errors import InputError


@dataclass(frozen=True)
class Extra:
    """One extra of the package."""

    library: str
    """Its name for people."""
    module: str
    """The module that is there once it is installed."""


EXTRAS = {
    "deep": Extra("PyTorch", "torch"),
    "mujoco": Extra("MuJoCo", "mujoco"),
    "box2d": Extra("Box2D", "Box2D"),
    "play": Extra("pygame", "pygame"),
}
"""By the name that `pip install 'deltatune[NAME]'` takes."""


def require(needs: Mapping[str, str]) -> None:
    """Raise InputError, with what to install, where an extra is missing.

    needs: the name of a task or an agent to the name of an extra; an empty one is no extra.
    """
    lacking: dict[str, list[str]] = {}
    for who, extra in needs.items():
        if extra and (extra in lacking or not _there(extra)):
            lacking.setdefault(extra, []).append(who)
    if not lacking:
        return
    said = [
        f"{', '.join(who)} {'needs' if len(who) == 1 else 'need'} {EXTRAS[extra].library}"
        for extra, who in lacking.items()
    ]
    verb = "is" if len(lacking) == 1 else "are"
    raise InputError(
        f"{', and '.join(said)}, which {verb} not installed: pip install 'deltatune[{','.join(sorted(lacking))}]'"
    )


def _there(extra: str) -> bool:
    return importlib.util.find_spec(EXTRAS[extra].module) is not None
