"""The wheel and the source distribution, in clean environments of every supported Python that is there."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("setuptools", "77", reason="builds with setuptools")
pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
MINORS = (11, 12, 13)
PACKAGES = ("trainables", "search_spaces", "orchestrator", "dashboards", "deltatune")
BUILD = "import sys, setuptools.build_meta as build; print(getattr(build, sys.argv[1])(sys.argv[2]))"


def run(*words: str | Path, cwd: Path, check: bool = True) -> subprocess.CompletedProcess[str]:
    """Run a command that sees nothing of this checkout."""
    env = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "DELTATUNE_STORAGE")}
    done = subprocess.run([str(word) for word in words], cwd=cwd, env=env, capture_output=True, text=True)
    assert not check or done.returncode == 0, done.stdout[-1000:] + done.stderr[-3000:]
    return done


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the source distribution, and of the wheel that is built from it."""
    folder = tmp_path_factory.mktemp("dist")
    tracked = ("git", "ls-files", "--cached", "--others", "--exclude-standard", "--")
    listed = run(*tracked, "pyproject.toml", "README.md", "LICENSE", *PACKAGES, cwd=ROOT, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout")
    source = folder / "source"
    for name in filter(lambda name: (ROOT / name).is_file(), listed.stdout.splitlines()):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    sdist = folder / run(sys.executable, "-c", BUILD, "build_sdist", folder, cwd=source).stdout.split()[-1]
    with tarfile.open(sdist) as archive:
        archive.extractall(folder, filter="data")
    run(sys.executable, "-c", BUILD, "build_wheel", folder, cwd=folder / sdist.name.removesuffix(".tar.gz"))
    return folder


def wheel(dist: Path) -> Path:
    (found,) = dist.glob("*.whl")
    return found


def test_the_wheel_made_from_the_source_distribution_has_every_file_of_the_packages(dist: Path) -> None:
    with zipfile.ZipFile(wheel(dist)) as archive:
        there = set(archive.namelist())
    files = [path for package in PACKAGES for path in (dist / "source" / package).rglob("*") if path.is_file()]
    assert {str(path.relative_to(dist / "source")) for path in files} <= there
    assert {f"{package}/py.typed" for package in PACKAGES} <= there
    assert any(name.endswith("licenses/LICENSE") for name in there)


def interpreter(minor: int) -> str | None:
    """Return a Python 3.`minor`, on the path or of pyenv, or None."""
    if sys.version_info[:2] == (3, minor):
        return sys.executable
    candidates = [shutil.which(f"python3.{minor}"), *(Path.home() / ".pyenv/versions").glob(f"3.{minor}.*/bin/python")]
    asked = "import sys, venv, ensurepip; print(sys.version_info[1])"
    for python in filter(None, candidates):
        said = subprocess.run([str(python), "-c", asked], capture_output=True, text=True).stdout.strip()
        if said == str(minor):
            return str(python)
    return None


@pytest.fixture(scope="module", params=MINORS, ids=lambda minor: f"3.{minor}")
def commands(request: pytest.FixtureRequest, dist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the commands of a clean environment with the wheel and no extra."""
    python = interpreter(request.param)
    if python is None:
        pytest.skip(f"no Python 3.{request.param} on this machine")
    folder = tmp_path_factory.mktemp(f"python3{request.param}")
    run(python, "-m", "venv", folder, cwd=folder)
    pip = (folder / "bin/python", "-m", "pip", "install", "--quiet", "--constraint", ROOT / "constraints.txt")
    done = run(*pip, wheel(dist), cwd=folder, check=False)
    if done.returncode and any(word in done.stderr for word in ("No matching distribution", "connection")):
        pytest.skip("the packages cannot be fetched here: " + done.stderr.splitlines()[-1])
    assert done.returncode == 0, done.stderr[-3000:]
    return folder / "bin"


def test_the_demo_runs_outside_of_the_repository_without_any_extra(commands: Path, tmp_path: Path) -> None:
    deltatune = commands / "deltatune"
    run(deltatune, "sweep", "demo", "--local", "--seeds", "2", "--set", "episodes=100", "--name", "try", cwd=tmp_path)
    assert (tmp_path / "results/try/report.html").stat().st_size > 1e6
    assert (tmp_path / "results/try/figures/curves.png").exists()
    assert run(deltatune, "export", "try", "-o", "best.yaml", cwd=tmp_path).returncode == 0
    assert '"$schema"' in run(deltatune, "spaces", "--schema", cwd=tmp_path).stdout
    run(commands / "python", "-c", "import deltatune; assert len(deltatune.load('try').best) > 8", cwd=tmp_path)
    libraries = run(commands / "python", "-m", "pip", "list", "--format", "freeze", cwd=tmp_path).stdout.lower()
    assert not [name for name in ("torch==", "mujoco==", "box2d==", "pygame==", "s3fs==") if name in libraries]


def test_a_deep_task_says_which_extra_brings_what_it_needs(commands: Path, tmp_path: Path) -> None:
    done = run(commands / "deltatune", "sweep", "smoke-table1", cwd=tmp_path, check=False)
    assert done.returncode == 2
    assert "pip install 'deltatune[box2d,deep,mujoco]'" in " ".join(done.stderr.split())
    assert not list(tmp_path.glob("results/smoke-table1/*"))
