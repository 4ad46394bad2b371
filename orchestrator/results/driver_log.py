"""The log of a sweep's drivers, SWEEP/driver.log: what happened when, for people and for `deltatune logs`."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trainables.storage.paths import is_local

FILE = "driver.log"

KEPT_LINES = 5000
"""Lines that are kept where a log cannot be appended to."""

PUT_EVERY = 10.0
"""Seconds between two writings of a log that is written whole."""


LOGGER = "deltatune"
"""The logger of the whole product; each package has one below it."""


@contextmanager
def logging_to(folder: Path) -> Iterator[None]:
    """Write what deltatune's loggers say to the driver log of a sweep, while the block runs. Blocks may nest."""
    logger = logging.getLogger(LOGGER)
    if any(isinstance(handler, _DriverLog) and handler.folder == folder for handler in logger.handlers):
        yield
        return
    handler, level = _DriverLog(folder), logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        handler.flush()


def flush() -> None:
    """Write out what the driver logs still hold back."""
    for handler in logging.getLogger(LOGGER).handlers:
        handler.flush()


class _DriverLog(logging.Handler):
    def __init__(self, folder: Path) -> None:
        super().__init__(logging.INFO)
        self.folder = folder
        self._journal = Journal(folder)

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if record.exc_info:
            text += f"\n{logging.Formatter().formatException(record.exc_info)}"
        self._journal.write(text)

    def flush(self) -> None:
        self._journal.close()


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
