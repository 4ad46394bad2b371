"""Paths of a storage folder: on this machine's disks, or at a URL that fsspec knows (s3://BUCKET/FOLDER, gs://...)."""

from __future__ import annotations

import os
from pathlib import Path
from typing import cast

from trainables.errors import InputError


def storage_path(text: str | Path) -> Path:
    """The folder that `text` names: a path, or a URL, which then has Path's methods to read and to write.

    Raises InputError for a URL of an unknown protocol, or one whose package is not installed.
    """
    if isinstance(text, Path) or "://" not in text:
        return Path(text)
    from upath import UPath

    protocol = text.split("://", 1)[0]
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
    """Whether a path is on a disk: it can be appended to, renamed and locked there."""
    return isinstance(path, Path)
