"""The driver log of a sweep, SWEEP/driver.log, which `deltatune logs` prints."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from trainables.storage.paths import is_local

FILE = "driver.log"

KEPT_LINES = 5000
"""Lines kept of a log on an object store, which cannot append."""

PUT_EVERY = 10.0
"""Seconds between two uploads of such a log."""

LOGGER = "deltatune"
"""The parent of all of deltatune's loggers."""

log = logging.getLogger("deltatune.results")


@contextmanager
def logging_to(folder: Path) -> Iterator[None]:
    """Write deltatune's log messages to the driver log of a sweep while the block runs. Blocks may nest."""
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
    """Write the buffered lines of the driver logs."""
    for handler in logging.getLogger(LOGGER).handlers:
        handler.flush()


class _DriverLog(logging.Handler):
    def __init__(self, folder: Path) -> None:
        super().__init__(logging.INFO)
        self.folder = folder
        self._file = LogFile(folder)

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if record.exc_info:
            text += f"\n{logging.Formatter().formatException(record.exc_info)}"
        self._file.write(text)

    def flush(self) -> None:
        self._file.close()


class LogFile:
    """Appends lines with their time. The first of a row of errors in writing is logged, here too once writing works."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE
        self._lines: list[str] | None = None if is_local(folder) else read(folder).splitlines()
        self._put, self._failing = 0.0, False

    def write(self, text: str) -> None:
        """Append a line."""
        line = f"{time.strftime('%Y-%m-%d %H:%M:%S', time.gmtime())} {' '.join(text.split())}"
        if self._lines is not None:
            self._lines.append(line)
            if time.monotonic() - self._put > PUT_EVERY:
                self.close()
            return
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
        except OSError as error:
            self._failed(error)
        else:
            self._failing = False

    def close(self) -> None:
        """Write all buffered lines."""
        if self._lines is None:
            return
        self._put = time.monotonic()
        try:
            self._path.write_text("\n".join(self._lines[-KEPT_LINES:]) + "\n")
        except Exception as error:  # each kind of storage raises different errors
            self._failed(error)
        else:
            self._failing = False

    def _failed(self, error: Exception) -> None:
        """Log an error in writing, but not those after it: each message comes back to this file."""
        if not self._failing:
            self._failing = True
            log.info("%s cannot be written: %s", self._path, error)


def read(folder: Path) -> str:
    """Return the log of a sweep; empty where there is none."""
    try:
        return (folder / FILE).read_text(encoding="utf-8")
    except OSError:
        return ""
