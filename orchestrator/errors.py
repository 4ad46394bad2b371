"""How a command ends when something goes wrong."""

from __future__ import annotations

import errno

from trainables.errors import InfrastructureError, InputError, one_line, shown
from trainables.storage.paths import foreign

BAD_PATH = (errno.ENAMETOOLONG, errno.ENOTDIR, errno.EISDIR, errno.ELOOP, errno.EINVAL)
"""What the system says of a path that is wrong in itself, wherever it is used."""

LONGEST = 2000
"""Most characters of a sentence."""


class SweepError(InfrastructureError):
    """A sweep that stopped for a reason outside of its cells; what is recorded stays, and the same command goes on."""


class InterruptedSweepError(SweepError):
    """Ctrl-C or SIGTERM in the middle of a stage."""


class LeaseLostError(OSError):
    """Another driver has taken over the sweep: this one must write nothing more."""


def exit_code(error: Exception) -> int | None:
    """Return 2 for bad input, 130 for an interruption, 1 for a sweep that stopped, a file that the system refuses or a
    storage that does not answer; None for an error of our own making.
    """
    if isinstance(error, InputError | UnicodeEncodeError) or (isinstance(error, OSError) and error.errno in BAD_PATH):
        return 2
    if isinstance(error, InterruptedSweepError):
        return 130
    return 1 if isinstance(error, SweepError | OSError) or foreign(error) else None


def sentence(error: Exception) -> str:
    """Return what an error says to people, in one line."""
    text = foreign(error) or str(error)
    if isinstance(error, UnicodeEncodeError):  # bytes on a command line that are no UTF-8
        text = f"{shown(error.object)} is no text that {error.encoding} can write"
    if isinstance(error, OSError) and error.strerror and error.filename:
        text = f"{error.filename}: {error.strerror}"
    text = one_line(text.strip())
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}…"
