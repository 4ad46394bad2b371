"""Paths of a storage folder: on this machine's disks, or at a URL that fsspec knows (s3://BUCKET/FOLDER, gs://...)."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any, cast
from urllib.parse import unquote, urlsplit

from trainables.errors import InputError

ON_DISK = ("", "file", "local")
"""fsspec's names of the protocols of this machine's disks."""


def storage_path(text: str | Path) -> Path:
    """Return the folder that `text` names: a path, or a URL, which then has Path's methods to read and to write.

    Raises InputError for a URL of an unknown protocol, or one whose package is not installed.
    """
    if isinstance(text, Path) or "://" not in text:
        return Path(text)
    protocol = text.split("://", 1)[0]
    if protocol in ON_DISK:
        return Path(unquote(urlsplit(text).path))
    from upath import UPath

    try:
        path = UPath(text, use_listings_cache=False)  # others write to it too
        path.exists()
    except ImportError as error:
        raise InputError(f"the storage {text} needs a package: {error}") from None
    except ValueError:
        raise InputError(f"a storage is a folder or a URL that fsspec knows (got the protocol '{protocol}')") from None
    except Exception as error:  # each protocol's package has errors of its own
        raise InputError(f"the storage {text} does not answer: {error}") from None
    return cast(Path, path)


def default_storage() -> str:
    """Return the storage that is meant where none is named: DELTATUNE_STORAGE, else the folder `results`."""
    return os.environ.get("DELTATUNE_STORAGE") or "results"


def is_local(path: object) -> bool:
    """Return whether a path is on a disk: it can be appended to, renamed and locked there.

    Before universal_pathlib 0.3 the path of a cloud was a `pathlib.Path` too, so that its own type is asked.
    """
    if "upath" not in sys.modules:  # then nothing can be one of its paths
        return isinstance(path, Path)
    from upath import UPath

    return path.protocol in ON_DISK if isinstance(path, UPath) else isinstance(path, Path)


def sizes(folder: Path) -> dict[str, int]:
    """Return the size of every file of a folder by its name, from one listing; empty where there is no folder."""
    try:
        if is_local(folder):
            with os.scandir(folder) as entries:
                return {entry.name: entry.stat().st_size for entry in entries if entry.is_file()}
        remote = cast(Any, folder)
        entries = remote.fs.ls(remote.path, detail=True)
    except (FileNotFoundError, NotADirectoryError):
        return {}
    return {entry["name"].rsplit("/", 1)[-1]: entry["size"] for entry in entries if entry["type"] == "file"}


def read_range(path: Path, start: int = 0, stop: int | None = None) -> bytes:
    """Return the bytes of a file from `start` to `stop` (default: its end), in one request where it is a URL."""
    if not is_local(path):
        remote = cast(Any, path)
        return bytes(remote.fs.cat_file(remote.path, start=start or None, end=stop))
    with path.open("rb") as file:
        file.seek(start)
        return file.read() if stop is None else file.read(stop - start)
