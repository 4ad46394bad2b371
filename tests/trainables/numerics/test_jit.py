"""The cache of compiled kernels can be neither stale nor in the way."""

from __future__ import annotations

import gc
import importlib
import os
import runpy
import sys
import time
from pathlib import Path

import numba
import pytest

from trainables.numerics import jit


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package of kernels of its own, with its cache beside it."""
    folder = tmp_path / "package"
    (folder / "tasks").mkdir(parents=True)
    (folder / "numerics").mkdir()
    (folder / "numerics" / "jit.py").write_text("")
    (folder / "tasks" / "kernel.py").write_text("from trainables.limits import MOST\n@compiled\n")
    (folder / "limits.py").write_text("MOST = 1\n")
    (folder / "plain.py").write_text("STEP = 1\n")
    monkeypatch.setattr(jit, "__file__", str(folder / "numerics" / "jit.py"))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    return folder


def _folder() -> str | None:
    return jit._cache_folder.__wrapped__()


def test_a_changed_kernel_or_constant_of_one_means_another_cache_folder(package: Path) -> None:
    first = _folder()
    assert first is not None
    assert Path(first).is_dir()
    assert _folder() == first
    (package / "limits.py").write_text("MOST = 2\n")
    second = _folder()
    (package / "tasks" / "kernel.py").write_text("@compiled\n")
    assert len({first, second, _folder()}) == 3


def test_a_changed_line_elsewhere_keeps_the_compiled_kernels(package: Path) -> None:
    first = _folder()
    (package / "plain.py").write_text("STEP = 2\n")
    assert _folder() == first


def test_an_unwritable_cache_means_no_cache_and_no_error(package: Path, tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "below"))
    assert _folder() is None
    monkeypatch.setattr(jit, "_cache_folder", lambda: None)
    function = jit.compiled(lambda x: x + 1)
    assert function(2) == 3


def test_compiling_leaves_numbas_own_setting_alone(package: Path, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(numba.config, "CACHE_LOCATOR_CLASSES", "somewhere")
    monkeypatch.setattr(jit, "_cache_folder", lambda: str(tmp_path))
    jit.compiled(test_compiling_leaves_numbas_own_setting_alone)
    assert numba.config.CACHE_LOCATOR_CLASSES == "somewhere"


def test_another_copy_of_the_same_files_compiles_nothing_and_a_changed_one_does(
    package: Path, tmp_path: Path, monkeypatch
) -> None:
    folder = _folder()
    assert folder is not None
    monkeypatch.setattr(jit, "_cache_folder", lambda: folder)
    text = "from trainables.numerics.jit import compiled\n\n\n@compiled\ndef double(x):\n    return 2 * x\n"
    copy, other = tmp_path / "copy", tmp_path / "other"
    for root, content in ((package, text), (copy, text), (other, text.replace("2 *", "3 *"))):
        (root / "tasks").mkdir(parents=True, exist_ok=True)
        (root / "tasks" / "double.py").write_text(content)
    found = []
    for root in (package, package, copy, other):
        monkeypatch.setattr(jit, "__file__", str(root / "numerics" / "jit.py"))
        double = runpy.run_path(str(root / "tasks" / "double.py"), run_name="double")["double"]
        found.append((double(4), sum(double.stats.cache_hits.values())))
    assert found == [(8, 0), (8, 1), (8, 1), (12, 0)]


def test_the_kernels_of_versions_unused_for_a_month_are_removed(package: Path, tmp_path: Path) -> None:
    first = _folder()
    assert first is not None
    (package / "limits.py").write_text("MOST = 2\n")
    kept, other = tmp_path / "cache" / ("a" * 16), tmp_path / "cache" / "not-ours"
    for folder, days in ((Path(first), 31), (kept, 29), (other, 400)):
        folder.mkdir(exist_ok=True)
        then = time.time() - 86400 * days
        os.utime(folder, (then, then))
    second = _folder()
    assert second is not None
    assert {path.name for path in (tmp_path / "cache").iterdir()} == {Path(second).name, kept.name, other.name}


def test_compilation_is_told_once_and_a_kernel_from_the_cache_is_none(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = _folder()
    monkeypatch.setattr(jit, "_cache_folder", lambda: folder)
    monkeypatch.syspath_prepend(tmp_path)
    file = tmp_path / "told_kernels.py"
    names = ("one", "two")
    file.write_text("\n\n".join(f"def {name}(x):\n    return x + 1" for name in names))

    def told() -> int:
        calls: list[None] = []
        sys.modules.pop(file.stem, None)
        defined = vars(importlib.import_module(file.stem))
        gc.collect()  # of what the first call has compiled, only the cache is left
        with jit.on_compilation(lambda: calls.append(None)):
            assert [jit.compiled(defined[name])(1) for name in names] == [2, 2]
        return len(calls)

    assert [told(), told()] == [1, 0]
