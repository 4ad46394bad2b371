"""How a command ends when something goes wrong."""

from __future__ import annotations

from trainables.errors import InfrastructureError, InputError


class SweepError(InfrastructureError):
    """A sweep that stopped for a reason outside of its cells; what is recorded stays, and the same command goes on."""


class InterruptedSweepError(SweepError):
    """Ctrl-C or SIGTERM in the middle of a stage."""


class LeaseLostError(OSError):
    """Another driver has taken over the sweep: this one must write nothing more."""


def exit_code(error: Exception) -> int | None:
    """Return 2 for bad input, 130 for an interruption, 1 for a sweep that stopped or a file that the system refuses;
    None for an error of our own making.
    """
    if isinstance(error, InputError):
        return 2
    if isinstance(error, InterruptedSweepError):
        return 130
    return 1 if isinstance(error, SweepError | OSError) else None


def sentence(error: Exception) -> str:
    """Return what an error says to people."""
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f"{error.filename}: {error.strerror}"
    return str(error)
