"""The log of a sweep's drivers, SWEEP/driver.log: what happened when, for people and for `deltatune logs`."""

from __future__ import annotations

import time
from pathlib import Path

from trainables.storage.paths import is_local

FILE = "driver.log"

KEPT_LINES = 5000
"""Lines that are kept where a log cannot be appended to."""

PUT_EVERY = 10.0
"""Seconds between two writings of a log that is written whole."""


class Journal:
    """Appends lines with their time. A log that cannot be written to stops no sweep."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE
        self._lines: list[str] | None = None if is_local(folder) else read(folder).splitlines()
        self._put = 0.0

    def write(self, text: str) -> None:
        """Add a line."""
        line = f"{time.strftime('%Y-%m-%d %H:%M:%S', time.gmtime())} {' '.join(text.split())}"
        if self._lines is not None:
            self._lines.append(line)
            if time.monotonic() - self._put > PUT_EVERY:
                self.close()
            return
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        except OSError:
            return

    def close(self) -> None:
        """See to it that all lines are there."""
        if self._lines is None:
            return
        self._put = time.monotonic()
        try:
            self._path.write_text("\n".join(self._lines[-KEPT_LINES:]) + "\n")
        except OSError:
            return


def read(folder: Path) -> str:
    """The log of a sweep; empty where there is none."""
    try:
        return (folder / FILE).read_text(encoding="utf-8")
    except OSError:
        return ""
