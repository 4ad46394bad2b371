"""Errors of a sweep, and the exit code and sentence with which a command ends."""

from __future__ import annotations

import errno

from trainables.errors import InfrastructureError, InputError, one_line, shown
from trainables.storage.paths import foreign

BAD_PATH = (errno.ENAMETOOLONG, errno.ENOTDIR, errno.EISDIR, errno.ELOOP, errno.EINVAL)
"""Error numbers of the operating system for paths that are invalid themselves."""

MAX_CHARACTERS = 2000
"""Of a sentence."""


class SweepError(InfrastructureError):
    """A sweep stopped for a reason outside its cells. Its records stay, and the same command continues."""


class InterruptedSweepError(SweepError):
    """Ctrl-C or SIGTERM in the middle of a stage."""


class LeaseLostError(OSError):
    """Another driver has taken over the sweep: this one must write nothing more."""


class LeaseUnknownError(OSError):
    """The storage does not say whether another process has taken over: do not write."""


def exit_code(error: Exception) -> int | None:
    """Return an error's exit code, or None for a bug in deltatune.

    2: bad input; 130: interruption; 1: a sweep that stopped, a file that the system refuses, an unreachable storage.
    """
    if isinstance(error, InputError | UnicodeEncodeError) or (isinstance(error, OSError) and error.errno in BAD_PATH):
        return 2
    if isinstance(error, InterruptedSweepError):
        return 130
    return 1 if isinstance(error, SweepError | OSError) or foreign(error) else None


def sentence(error: Exception) -> str:
    """Return an error's message in one line."""
    text = foreign(error) or str(error)
    if isinstance(error, UnicodeEncodeError):  # bytes on a command line that are no UTF-8
        text = f"{shown(error.object)} cannot be written in {error.encoding}"
    if isinstance(error, OSError) and error.strerror and error.filename:
        text = f"{error.filename}: {error.strerror}"
    text = one_line(text.strip())
    return text if len(text) <= MAX_CHARACTERS else f"{text[:MAX_CHARACTERS]}…"
