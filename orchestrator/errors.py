"""How a command ends when something goes wrong."""

from __future__ import annotations

from trainables.errors import InfrastructureError, InputError


class SweepError(InfrastructureError):
    """A sweep that stopped for a reason outside of its cells; what is recorded stays, and the same command goes on."""


class InterruptedSweepError(SweepError):
    """Ctrl-C or SIGTERM in the middle of a stage."""


def exit_code(error: Exception) -> int | None:
    """2 for bad input, 130 for an interruption, 1 for a sweep that stopped; None for an error of our own making."""
    if isinstance(error, InputError):
        return 2
    if isinstance(error, InterruptedSweepError):
        return 130
    return 1 if isinstance(error, SweepError) else None
