"""Paths of a storage folder: on a disk, or at a URL that fsspec supports (s3://BUCKET/FOLDER, gs://...)."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any, cast
from urllib.parse import unquote

from trainables.errors import InputError

ON_DISK = ("", "file", "local")
"""fsspec's protocols of local disks."""


WRITABLE = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "adl", "hdfs", "webhdfs", "sftp", "ssh", "smb", "memory")
"""fsspec's protocols for a storage; others are read-only, or cannot overwrite."""

_PACKAGES = ("botocore", "aiobotocore", "s3fs", "gcsfs", "google", "azure", "adlfs", "aiohttp", "fsspec", "paramiko")
"""Packages that implement these protocols, each with its own exceptions."""


def storage_path(text: str | Path) -> Path:
    """Return the folder that `text` names: a path, or a UPath for a URL, with the methods of Path.

    Raises InputError for text that names no folder, and for a URL whose protocol is read-only, that has no bucket,
    whose package is not installed, or that does not answer.
    """
    if isinstance(text, Path):
        return text
    if not text.strip() or "\0" in text:
        raise InputError(f"a storage is a folder, or a URL such as s3://BUCKET/FOLDER (got {text!r})")
    protocol, there, _ = text.partition("://")
    if not there:
        return Path(text)
    if protocol in ON_DISK and text.startswith(f"{protocol}:///"):
        return Path(unquote(text.partition("://")[2]))
    _check_url(text, protocol)
    from fsspec import get_filesystem_class
    from upath import UPath

    try:
        path = UPath(text, use_listings_cache=False)  # other processes write to it too
        path.exists()
    except ImportError as error:
        raise InputError(f"the storage {text} needs a package: {error}") from None
    except Exception as error:  # each protocol's package raises different errors
        get_filesystem_class(protocol).clear_instance_cache()  # the environment may differ next time
        raise InputError(f"the storage {text} does not answer: {_words(error)}") from None
    return cast(Path, path)


def _check_url(text: str, protocol: str) -> None:
    """Raise InputError for a URL that cannot be a storage, before any package is imported for it."""
    if protocol not in WRITABLE:
        allowed = ", ".join(["file:///", *(f"{name}://" for name in WRITABLE)])
        raise InputError(f"a storage is a folder, or a URL that starts with {allowed} (got '{text}')")
    if protocol != "memory" and not text.partition("://")[2].partition("/")[0].strip():
        raise InputError(f"a storage's URL is {protocol}://BUCKET/FOLDER (got '{text}')")


def foreign(error: BaseException) -> str | None:
    """Return the message of an error from a storage's package, as a sentence; None for any other error."""
    if type(error).__module__.partition(".")[0] not in _PACKAGES:
        return None
    return f"the storage does not answer: {_words(error)}"


def _words(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def default_storage() -> str:
    """Return the default storage: DELTATUNE_STORAGE, else the folder `results`."""
    return os.environ.get("DELTATUNE_STORAGE") or "results"


def is_local(path: object) -> bool:
    """Return whether a path is on a disk, where files can be appended to, renamed and locked.

    Before universal_pathlib 0.3 cloud paths were instances of `pathlib.Path` too, so this checks for UPath.
    """
    if "upath" not in sys.modules:  # then no path can be a UPath
        return isinstance(path, Path)
    from upath import UPath

    return path.protocol in ON_DISK if isinstance(path, UPath) else isinstance(path, Path)


def is_file(path: Path) -> bool:
    """Return whether there is a file of that name; False also for an invalid name."""
    return os.path.isfile(path) if is_local(path) else path.is_file()


def sizes(folder: Path) -> dict[str, int]:
    """Return the sizes of a folder's files by name, from one listing; empty without a folder."""
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
