"""The container file: what it copies is there, what it must not copy cannot get in, and nobody is root at the end."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PINS = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().split() if "==" in line)


def instructions() -> list[tuple[str, str]]:
    """The (instruction, argument) pairs of the container file, continued lines joined."""
    text = re.sub(r"^#.*\n", "", (ROOT / "deploy/Dockerfile").read_text(), flags=re.MULTILINE)
    lines = [line for line in re.sub(r"\\\n", "", text).splitlines() if line.strip()]
    return [(name, argument) for name, _, argument in (line.partition(" ") for line in lines)]


def arguments(instruction: str) -> list[str]:
    return [argument for name, argument in instructions() if name == instruction]


def copied() -> list[str]:
    return [word for line in arguments("COPY") if "--from" not in line for word in line.split()[:-1]]


def test_the_base_is_pinned_to_a_patch_of_a_python_that_deltatune_supports() -> None:
    bases = {line.split()[0] for line in arguments("FROM")}
    assert len(bases) == 1
    version = re.fullmatch(r"python:(\d+)\.(\d+)\.\d+-slim-\w+", bases.pop())
    assert version is not None
    assert PROJECT["requires-python"] == ">=3.11"
    assert (3, 11) <= (int(version[1]), int(version[2])) < (3, 14)


def test_nobody_is_root_at_the_end() -> None:
    last = instructions()[max(index for index, (name, _) in enumerate(instructions()) if name == "FROM") :]
    users = [argument for name, argument in last if name == "USER"]
    assert re.fullmatch(r"[1-9]\d*:[1-9]\d*", users[-1]), "Kubernetes can tell only a number from root"
    after = last[last.index(("USER", users[-1])) :]
    assert not [name for name, _ in after if name in ("RUN", "COPY", "ADD")]


def test_the_process_gets_its_signals() -> None:
    assert json.loads(arguments("ENTRYPOINT")[-1]) == ["tini", "--"]
    assert json.loads(arguments("CMD")[-1])[0] in ("deltatune",)


def test_what_is_copied_is_there_and_is_everything() -> None:
    assert not [source for source in copied() if not (ROOT / source).exists()]
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {"benchmarks", "tests"}
    assert packages <= set(copied())
    assert {"pyproject.toml", "constraints.txt", *PROJECT["license-files"], PROJECT["readme"]} <= set(copied())


def test_nothing_else_reaches_the_builder() -> None:
    lines = (ROOT / ".dockerignore").read_text().splitlines()
    first, *rest = [line for line in lines if line and not line.startswith("#")]
    assert first == "*"
    assert {line[1:] for line in rest if line.startswith("!")} == set(copied())


def test_the_packages_are_the_pinned_ones_of_a_cluster(tmp_path: Path) -> None:
    (install,) = [line for line in arguments("RUN") if "--requirement" in line]
    assert "--constraint constraints.txt" in install
    script = re.search(r'python -c "([^"]+)"', install)
    assert script is not None
    listed = subprocess.run([sys.executable, "-c", script[1]], cwd=ROOT, capture_output=True, text=True, check=True)
    extras = PROJECT["optional-dependencies"]
    wanted = [package for extra in ("box2d", "cluster", "deep", "mujoco", "s3") for package in extras[extra]]
    assert listed.stdout.split("\n")[:-1] == [*PROJECT["dependencies"], *wanted]


@pytest.mark.parametrize("name", ["ray", "mlflow", "torch"])
def test_the_pins_are_what_the_tests_run_with(name: str) -> None:
    from importlib.metadata import version

    assert version(name).partition("+")[0] == PINS[name]


def test_every_file_names_the_same_versions() -> None:
    job = yaml.safe_load((ROOT / "deploy/rayjob.yaml").read_text())["spec"]["rayClusterSpec"]
    assert job["rayVersion"] == PINS["ray"]
    tags = set()
    for file in (*ROOT.glob("deploy/*"), ROOT / "docs/clusters.md"):
        tags |= set(re.findall(r"\bdeltatune:(\d[\w.]*)", file.read_text()))
    assert tags == {PROJECT["version"]}
