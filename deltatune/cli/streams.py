"""Standard output and error that tolerate being closed, full, or without a reader.

What cannot be written is dropped, the command finishes its work, and one sentence on standard error says so.
"""

from __future__ import annotations

import errno
import io
import os
import sys
from typing import TextIO


class _Lenient(io.RawIOBase):
    """A raw stream on a file descriptor that keeps its first error and drops whatever is written after it."""

    def __init__(self, descriptor: int, error: OSError | None) -> None:
        self._descriptor, self.error = descriptor, error

    def writable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._descriptor

    def isatty(self) -> bool:
        return self.error is None and os.isatty(self._descriptor)

    def write(self, data: object, /) -> int:
        """Return the number of bytes written; after an error, pretend that all were."""
        view = memoryview(data)  # type: ignore[arg-type]
        if self.error is None:
            try:
                return os.write(self._descriptor, view)
            except OSError as error:
                self.error = error
        return view.nbytes


class Streams:
    """Replaces standard output and error of this process by tolerant streams."""

    def __init__(self) -> None:
        closed = [_opened(descriptor) for descriptor in (0, 1, 2)]
        self._raw = {name: _Lenient(number, closed[number]) for name, number in (("stdout", 1), ("stderr", 2))}
        for name, raw in self._raw.items():
            before: TextIO | None = getattr(sys, name)
            if before is None or before is getattr(sys, f"__{name}__"):  # else another's, such as a test's
                setattr(sys, name, _text(raw, before))

    def failure(self) -> str | None:
        """Return a sentence on why standard output is incomplete, or None; a reader that left is no failure."""
        for name in self._raw:
            stream: TextIO | None = getattr(sys, name)
            if stream is not None:
                stream.flush()
        error = self._raw["stdout"].error
        if error is None or error.errno in (errno.EPIPE, errno.EIO):  # `| head`, a terminal that is gone
            return None
        return f"standard output is incomplete ({error.strerror}); the files that the command wrote are complete"


def _opened(descriptor: int) -> OSError | None:
    """Open the null device on a closed descriptor, so that no file opened later gets its number."""
    try:
        os.fstat(descriptor)
    except OSError as error:
        null = os.open(os.devnull, os.O_RDWR)
        if null != descriptor:
            os.dup2(null, descriptor)
            os.close(null)
        return error
    return None


def _text(raw: _Lenient, before: TextIO | None) -> TextIO:
    encoding = getattr(before, "encoding", None) or "utf-8"
    errors = getattr(before, "errors", None) or "backslashreplace"
    text = io.TextIOWrapper(io.BufferedWriter(raw), encoding, errors, line_buffering=raw.isatty())
    if raw.fileno() == 2:
        text.reconfigure(line_buffering=True)
    return text
