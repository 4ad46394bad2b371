"""A disk that keeps what was synchronised and no more, and one that does not even do that; an object store."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.simulation.world import World

Choose = Callable[[Sequence[Any]], Any]
"""Settles what a power loss leaves."""


@dataclass(eq=False)
class File:
    """What a file holds: for those who read it now, and after a power loss."""

    live: bytes = b""
    safe: bytes = b""


@dataclass
class Handle:
    """An open file."""

    path: Path
    file: File

    def __enter__(self) -> Handle:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    def tell(self) -> int:
        return len(self.file.live)


Change = tuple[str, Path, File | None]
"""(what, path, file) of a change of a name: 'link' or 'unlink'."""


class Disk:
    """Takes the place of `trainables.storage.disk`: a folder that shows the live state, and the state that is safe."""

    def __init__(self, world: World, root: Path) -> None:
        self._world, self.root = world, root
        self._live: dict[Path, File] = {}
        self._safe: dict[Path, File] = {}
        self._pending: list[list[Change]] = []
        """Changes of names that may be lost; those of one list together (a rename)."""
        self._full = 0.0
        self.steps = 0
        self.harm: Callable[[int, str, Handle | None, bytes], None] | None = None
        """Is told the number of each step before it is taken, and what it is; may raise Crash."""

    def _step(self, what: str, handle: Handle | None = None, data: bytes = b"") -> None:
        self.steps += 1
        if self.harm is not None:
            self.harm(self.steps, what, handle, data)
        self._world.step()

    def _room(self) -> None:
        """Raise OSError where the disk is full, or refuses."""
        world = self._world
        if world.chance("full disk"):
            self._full = world.now + world.random.uniform(1, 100)
        if world.now < self._full and not world.calm and not (world.driver and world.driver.quiet):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if world.chance("disk error"):
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    def create(self, path: Path) -> Handle:
        self._step("create")
        self._room()
        path.touch(exist_ok=False)
        self._live[path] = file = File()
        self._pending.append([("link", path, file)])
        return Handle(path, file)

    def extend(self, path: Path) -> Handle:
        if path in self._live:
            return Handle(path, self._live[path])
        return self.create(path)

    def write(self, handle: Handle, data: bytes) -> None:
        self._step("write", handle, data)
        world = self._world
        if world.chance("torn write"):
            self.extend_live(handle, data[: world.random.randrange(len(data))])
            world.die()
        if world.chance("short write"):
            self.extend_live(handle, data[: world.random.randrange(len(data))])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self._room()
        self.extend_live(handle, data)

    def extend_live(self, handle: Handle, data: bytes) -> None:
        with handle.path.open("ab") as real:
            real.write(data)
        handle.file.live += data

    def sync(self, handle: Handle) -> None:
        self._step("sync")
        self._room()
        if self._world.chance("lying sync"):
            self._world.lied = True
            return
        handle.file.safe = handle.file.live

    def truncate(self, path: Path, length: int) -> None:
        self._step("truncate")
        os.truncate(path, length)
        self._live[path].live = self._live[path].live[:length]

    def replace(self, old: Path, new: Path) -> None:
        self._step("replace")
        os.replace(old, new)
        self._live[new] = file = self._live.pop(old)
        self._pending.append([("unlink", old, None), ("link", new, file)])

    def remove(self, path: Path) -> None:
        self._step("remove")
        path.unlink(missing_ok=True)
        if self._live.pop(path, None) is not None:
            self._pending.append([("unlink", path, None)])

    def put(self, path: Path, data: bytes) -> None:
        """Of an object store: whole or not at all, though it may be written and yet seem not to be."""
        self._step("put")
        self._room()
        path.write_bytes(data)
        if self._world.chance("lost answer"):
            raise OSError(errno.ETIMEDOUT, os.strerror(errno.ETIMEDOUT))
        self._step("put answered")

    def sync_folder(self, folder: Path) -> None:
        self._step("sync folder")
        if self._world.chance("rename that does not last"):
            self._world.lied = True
            return
        mine = [changes for changes in self._pending if changes[0][1].parent == folder]
        for changes in mine:
            self._settle(changes)
            self._pending.remove(changes)

    def _settle(self, changes: list[Change]) -> None:
        for what, path, file in changes:
            if what == "unlink":
                self._safe.pop(path, None)
            elif file is not None:
                self._safe[path] = file

    def lose_power(self, choose: Choose | None = None) -> None:
        """Keep what is safe, and of the rest what chance leaves: the whole machine has stopped."""
        rng = self._world.random
        choose = choose or rng.choice
        for changes in self._pending:
            if choose((True, False)):
                self._settle(changes)
        self._pending.clear()
        for path in self._live:
            path.unlink(missing_ok=True)
        self._live = dict(self._safe)
        for path, file in self._live.items():
            file.live = file.safe = self._torn(file, choose)
            path.write_bytes(file.live)
        for path in self.root.rglob("*.parquet"):  # never synchronised
            path.write_bytes(path.read_bytes()[: rng.randrange(100)])

    def _torn(self, file: File, choose: Choose) -> bytes:
        """What is left of a file."""
        rng, safe, live = self._world.random, file.safe, file.live
        if live == safe:
            return safe
        if not live.startswith(safe):  # cut off since
            return bytes(choose((live, safe)))
        more = live[len(safe) :]
        kept = more[: rng.randrange(len(more) + 1)]
        return safe + bytes(choose((b"", kept, kept + bytes(rng.randrange(200)), more, bytes(len(more)))))


def clear(folder: Path) -> None:
    """Remove an object store's folder."""
    with suppress(FileNotFoundError):
        folder.fs.rm(folder.path, recursive=True)  # type: ignore[attr-defined]
