"""One driver at a sweep: a file lock on a disk, a lease that is kept alive where the storage is an object store."""

from __future__ import annotations

import json
import os
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import filelock

from trainables.errors import InputError
from trainables.storage.paths import is_local

LOCK, DRIVER = ".lock", ".driver.json"
"""Files of a sweep's folder: the lock of the process that runs it, and who that is."""

LEASE_SECONDS = 60.0
"""After so long without a sign of life a lease is free."""

SETTLE_SECONDS = 2.0
"""How long to wait before looking whether another took the lease at the same moment."""


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the sweep in `folder`; InputError that names the driver that does already. A dead driver's lock is free."""
    with _file_lock(folder) if is_local(folder) else _lease(folder):
        yield


def driver(folder: Path) -> str | None:
    """Who runs the sweep now, None where nobody does."""
    if not is_local(folder):
        who = _read(folder)
        return _words(who) if who and _alive(who) else None
    lock = filelock.FileLock(folder / LOCK)
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout:
        return _words(_read(folder))
    except OSError:  # a storage that may only be read
        return None
    lock.release()
    return None


@contextmanager
def _file_lock(folder: Path) -> Iterator[None]:
    lock = filelock.FileLock(folder / LOCK)
    try:
        lock.acquire(timeout=0)
    except filelock.Timeout:
        raise _taken(folder, _read(folder)) from None
    try:
        _write(folder, _me())
        yield
    finally:
        (folder / DRIVER).unlink(missing_ok=True)
        lock.release()


@contextmanager
def _lease(folder: Path) -> Iterator[None]:
    before, me = _read(folder), _me()
    if before and _alive(before):
        raise _taken(folder, before)
    _write(folder, me)
    time.sleep(SETTLE_SECONDS)
    there = _read(folder)
    if there is None or there.get("token") != me["token"]:
        raise _taken(folder, there)
    gone = threading.Event()
    keeper = threading.Thread(target=_keep, args=(folder, me, gone), daemon=True)
    keeper.start()
    try:
        yield
    finally:
        gone.set()
        keeper.join()
        (folder / DRIVER).unlink(missing_ok=True)


def _keep(folder: Path, me: dict[str, Any], gone: threading.Event) -> None:
    while not gone.wait(LEASE_SECONDS / 4):
        try:
            _write(folder, me | {"alive": time.time()})
        except OSError:
            continue  # the storage is away for a moment


def _me() -> dict[str, Any]:
    now = time.time()
    return {"pid": os.getpid(), "host": os.uname().nodename, "since": now, "alive": now, "token": uuid.uuid4().hex}


def _alive(who: dict[str, Any]) -> bool:
    """Whether the holder of a lease has shown a sign of life; a process of this machine is looked up."""
    if who.get("host") == os.uname().nodename and not _runs(int(who.get("pid", 0))):
        return False
    return time.time() - float(who.get("alive", 0)) < LEASE_SECONDS


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _taken(folder: Path, who: dict[str, Any] | None) -> InputError:
    return InputError(f"the sweep in {folder} is being run by {_words(who)}: wait for it, or stop it")


def _words(who: dict[str, Any] | None) -> str:
    return f"process {who.get('pid')} on {who.get('host')}" if who else "another process"


def _write(folder: Path, who: dict[str, Any]) -> None:
    (folder / DRIVER).write_text(json.dumps(who))


def _read(folder: Path) -> dict[str, Any] | None:
    try:
        who = json.loads((folder / DRIVER).read_text())
    except (OSError, ValueError):
        return None
    return who if isinstance(who, dict) else None
