"""Where a storage is: a disk can be locked and renamed on, an object store cannot, whatever its path's class says."""

from __future__ import annotations

from pathlib import Path

import pytest
from upath import UPath

from trainables.storage.paths import is_local, read_range, sizes, storage_path


@pytest.mark.parametrize(
    ("path", "local"),
    [
        (Path("/tmp/x"), True),
        (UPath("/tmp/x"), True),
        (UPath("memory://x"), False),
        (storage_path("memory://x"), False),
        (storage_path("file:///tmp/with%20space"), True),
        ("s3://x", False),
        (None, False),
    ],
)
def test_only_a_path_on_a_disk_is_local(path: object, local: bool) -> None:
    assert is_local(path) is local


def test_a_path_of_an_older_universal_pathlib_is_not_taken_for_a_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """There a cloud's path was a `pathlib.Path` too."""
    import upath

    class Both(type(Path())):  # type: ignore[misc]
        protocol = "s3"

    monkeypatch.setattr(upath, "UPath", Both)
    assert not is_local(Both("bucket/x"))


def test_a_file_url_is_a_folder() -> None:
    assert storage_path("file:///tmp/with%20space") == Path("/tmp/with space")


@pytest.mark.parametrize("where", ["disk", "memory"])
def test_a_folder_is_listed_and_a_part_of_a_file_read(tmp_path: Path, where: str) -> None:
    folder = tmp_path if where == "disk" else storage_path("memory://deltatune/paths")
    assert sizes(folder / "nowhere") == {}
    (folder / "a").write_bytes(b"0123456789")
    (folder / "b").write_bytes(b"")
    assert sizes(folder) == {"a": 10, "b": 0}
    assert read_range(folder / "a", 3, 6) == b"345"
    assert read_range(folder / "a", 8) == b"89"
    assert read_range(folder / "a") == b"0123456789"
