"""The lock of a sweep, which allows one driver: a file lock on a disk, a lease with heartbeat on an object store.

Readers never take the lock: they read who the driver is and whether it is alive.
"""

from __future__ import annotations

import json
import logging
import os
import threading
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from orchestrator import clock
from orchestrator.errors import LeaseLostError, LeaseUnknownError
from orchestrator.results.processes import machine, runs, started_at
from trainables.errors import InputError
from trainables.storage import disk
from trainables.storage.atomic import write_atomic
from trainables.storage.paths import is_local, read_range

log = logging.getLogger("deltatune.lock")

LOCK, DRIVER = ".lock", ".driver.json"
"""Files in a sweep's folder: the lock of the driver, and the driver's identity."""

LEASE_SECONDS = 60.0
"""A lease without a heartbeat for this long has expired."""

SETTLE_SECONDS = 2.0
"""Seconds to wait before checking whether another driver took the lease at the same moment."""

SLOW_SECONDS = 1.0
"""A write that takes longer may have replaced the lease of a driver that took it meanwhile and has started to work."""

Who = dict[str, Any]


@dataclass
class Hold:
    """A lock that is held."""

    folder: Path
    who: Who
    token: str = ""
    """Part of the names of this holder's record segments; empty on a disk, where the lock cannot be lost."""
    takeovers: int = 0
    """How many holders in a row have not given the lease back before this one: each may still finish one request."""
    lost: bool = False
    """Whether another holds the lease now."""
    _file: str = DRIVER
    _beat: float = field(default_factory=lambda: clock.since_boot())
    """When the last heartbeat that was written began. No other driver takes the lease within half its length of it."""
    _beating: bool = False
    """Whether a heartbeat is under way, which may replace the lease of another holder at any moment."""

    def check(self) -> None:
        """Raise LeaseLostError where another holds the lease; verify that if the last heartbeat is too old."""
        with suppress(LeaseUnknownError):
            self.check_surely()

    def check_surely(self) -> None:
        """Raise LeaseLostError as `check` does, and LeaseUnknownError where the storage does not answer."""
        if self.token and not self.lost and self._overdue():
            self.verify()
        if self.lost:
            raise LeaseLostError(
                f"the sweep in {self.folder} was taken over by {_words(_read(self.folder, self._file))} while this "
                "driver did not reach the storage: what it has recorded is kept"
            )

    def verify(self) -> None:
        """Look up who holds the lease. Raises LeaseUnknownError where the storage does not answer."""
        try:
            there = json.loads(read_range(self.folder / self._file))
        except (FileNotFoundError, ValueError):  # or a driver that took it over has ended since
            there = {} if self._overdue() else self.who
        except Exception as error:  # each kind of storage raises different errors
            raise LeaseUnknownError(f"cannot look up who holds the lease: {error}") from error
        ours = not isinstance(there, dict) or there.get("token") == self.who["token"]
        if not ours or (self._beating and self._overdue()):
            self.lost = True

    def beat(self) -> None:
        """Write a heartbeat, unless the lease is lost. Give the lease up where another may have taken it meanwhile."""
        began = clock.since_boot()
        if self.token:
            self.verify()
        if self.lost:
            return
        self._beating = True
        try:
            _write(self.folder, self._file, self.who | {"alive": clock.time()})
        finally:
            self.lost |= bool(self.token) and clock.since_boot() - began > SLOW_SECONDS and self._overdue()
            self._beating = False
        if self.lost:
            self._unlink()
        self._beat = began

    def _overdue(self) -> bool:
        """Return whether another may have taken the lease since the last heartbeat."""
        return clock.since_boot() - self._beat > LEASE_SECONDS / 2

    def remove(self) -> None:
        """Remove the holder's file, unless it is another holder's by now."""
        if not self.lost:
            self._unlink()

    def _unlink(self) -> None:
        if not self.token or (_read(self.folder, self._file) or {}).get("token") == self.who["token"]:
            disk.remove(self.folder / self._file)


@contextmanager
def locked(folder: Path, on_lost: Callable[[], None] = lambda: None) -> Iterator[Hold]:
    """Hold the sweep's lock. Raises InputError, which names the driver that holds it. A dead driver's lock is free.

    on_lost: called from another thread when another driver has taken the lease on an object store.
    """
    what = f"the sweep in {folder} is being run by "
    with _held(folder, LOCK, DRIVER, what, on_lost) as hold:
        yield hold


@contextmanager
def writing_to(folder: Path, key: str, title: str) -> Iterator[Hold]:
    """Hold the lock for writing the sweep in `folder` to a tracker, as its driver or `deltatune sync` does.

    key: the tracker's, part of the names of the lock's files. Raises InputError, which names the present holder.
    """
    what = f"the sweep in {folder} is being written into {title} by "
    with _held(folder, f".{key}.lock", f".{key}.json", what) as hold:
        yield hold


def driver(folder: Path) -> str | None:
    """Return who runs the sweep now, or None. Takes no lock and changes nothing."""
    who = _read(folder, DRIVER)
    return _words(who) if who and _alive(who) else None


@contextmanager
def _held(folder: Path, lock: str, file: str, what: str, on_lost: Callable[[], None] = lambda: None) -> Iterator[Hold]:
    with _file_lock(folder, lock, file, what) if is_local(folder) else _lease(folder, file, what) as hold:
        gone = threading.Event()
        keeper = clock.in_background(partial(_keep, hold, gone, on_lost), "lease")
        try:
            yield hold
        finally:
            gone.set()
            keeper.join()
            try:
                hold.remove()
            except Exception as error:  # an unreachable storage: the lease expires in a minute
                log.info("the lock in %s is not removed: %s", folder, error)


@contextmanager
def _file_lock(folder: Path, name: str, file: str, what: str) -> Iterator[Hold]:
    import filelock

    lock = filelock.FileLock(folder / name, thread_local=False)  # one thread takes it, another may free it
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout:
        raise _taken(what, _read(folder, file)) from None
    try:
        hold = Hold(folder, _me(), _file=file)
        _write(folder, file, hold.who)
        yield hold
    finally:
        lock.release()


@contextmanager
def _lease(folder: Path, file: str, what: str) -> Iterator[Hold]:
    before, me = _look_up(folder, file), _me()
    if before and (_alive(before) or _changes(folder, file, before)):
        raise _taken(what, _read(folder, file) or before)
    began = clock.since_boot()
    if (there := _look_up(folder, file)) != before:
        raise _taken(what, there)
    me["takeovers"] = takeovers = int(before.get("takeovers", 0)) + 1 if before else 0
    _write(folder, file, me)
    slow = clock.since_boot() - began > SLOW_SECONDS
    clock.sleep(LEASE_SECONDS / 2 if slow else SETTLE_SECONDS)  # a driver that it was taken from must notice
    there = _read(folder, file)
    if there is None or there.get("token") != me["token"]:
        raise _taken(what, there)
    yield Hold(folder, me, me["token"][:8], takeovers, _file=file, _beat=began)


def _changes(folder: Path, file: str, before: Who) -> bool:
    """Return whether a holder with an old heartbeat sends another one: the clocks of two machines may differ."""
    if _here(before):
        return False
    until = clock.monotonic() + LEASE_SECONDS / 2
    while clock.monotonic() < until:
        clock.sleep(LEASE_SECONDS / 20)
        if _read(folder, file) != before:
            return True
    return False


def _keep(hold: Hold, gone: threading.Event, on_lost: Callable[[], None]) -> None:
    """Send heartbeats as long as the holder has the lease."""
    while not clock.wait(gone, LEASE_SECONDS / 4):
        try:
            hold.beat()
            if hold.lost:
                on_lost()
                return
        except Exception as error:  # the storage is unreachable for a moment
            log.info("no heartbeat in %s: %s", hold.folder, error)


def _me() -> Who:
    now = clock.time()
    me = {"pid": os.getpid(), "host": os.uname().nodename, "machine": machine(), "started": started_at(os.getpid())}
    return me | {"since": now, "alive": now, "token": uuid.uuid4().hex}


def _alive(who: Who) -> bool:
    """Return whether a holder is alive: by its process if it is on this machine, else by its heartbeat."""
    if _here(who):
        return runs(int(who.get("pid", 0)), who.get("started"))
    return abs(clock.time() - float(who.get("alive", 0))) < LEASE_SECONDS


def _here(who: Who) -> bool:
    """Return whether a holder's process would be visible to this process."""
    if "machine" in who:
        return bool(who["machine"] == machine())
    return who.get("host") == os.uname().nodename


def _taken(what: str, who: Who | None) -> InputError:
    return InputError(f"{what}{_words(who)}: wait for it, or stop it")


def _words(who: Who | None) -> str:
    return f"process {who.get('pid')} on {who.get('host')}" if who else "another process"


def _write(folder: Path, file: str, who: Who) -> None:
    write_atomic(folder / file, json.dumps(who).encode())


def _look_up(folder: Path, file: str) -> Who | None:
    """Return who holds the lock, or None. Raises InputError where the storage does not answer."""
    try:
        who = json.loads(read_range(folder / file))
    except (FileNotFoundError, ValueError):
        return None
    except OSError as error:
        raise InputError(f"cannot look up who holds {folder / file}: {error.strerror or error}") from None
    return who if isinstance(who, dict) else None


def _read(folder: Path, file: str) -> Who | None:
    """Return who holds the lock; None where nobody does, and where the storage does not answer."""
    try:
        return _look_up(folder, file)
    except InputError:
        return None
