"""A Ray cluster of three nodes on this machine: joined, sent a job, and robbed of a node and of its head.

The tests share it: each gets a head and two nodes, and what one takes away the next is given anew. The head goes last.
"""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import LONGER
from harness import PATIENCE, assert_same, driver, ended, space, sweep, wait_for

from orchestrator.cluster import jobs
from orchestrator.results.lock import driver as driver_of
from orchestrator.results.sweep_folder import Results
from tests.deltatune.cli.in_process import command
from tests.faults.ray_cluster import NODES, TOKEN, Cluster

pytest.importorskip("ray.dashboard.optional_deps", reason="needs ray[default]")
pytest.importorskip("aiohttp_cors", reason="needs ray[default]")


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    with tempfile.TemporaryDirectory(prefix="dt-", dir="/tmp", ignore_cleanup_errors=True) as folder:
        there = Cluster(Path(folder) / "ray", nodes=1)
        try:
            yield there
        finally:
            there.close()


def submit(cluster: Cluster, file: Path, storage: Path, **changes: Any) -> subprocess.CompletedProcess[str]:
    """`deltatune submit` of the space that is written to `file`."""
    file.write_text(yaml.safe_dump(space(**changes), sort_keys=False))
    words = ["submit", str(file), "--address", cluster.jobs, "--storage", str(storage), "--no-mlflow"]
    command = [sys.executable, "-m", "deltatune.cli.main", *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, env=TOKEN)


def with_a_disk_of_its_own(folder: Path) -> list[str]:
    """The words before a command that sees an empty disk where others see `folder`."""
    words = ["unshare", "--mount", "sh", "-c", 'mount -t tmpfs none "$0" && exec "$@"', str(folder)]
    if os.geteuid() != 0:
        words.insert(1, "--map-root-user")
    try:
        subprocess.run([*words, "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this machine gives no process a disk of its own")
    return words


def test_a_job_takes_the_files_along_that_its_command_names(tmp_path: Path) -> None:
    from search_spaces.loading import load

    class Head:
        """Notes what it is sent."""

        def submit_job(self, entrypoint: str, runtime_env: dict[str, str], metadata: dict[str, str]) -> str:
            folder = Path(runtime_env["working_dir"])
            self.entrypoint, self.files = entrypoint, {path.name: path for path in folder.iterdir()}
            self.space = load(str(folder / jobs.SPACE_FILE))
            return "job"

    head = Head()
    (tmp_path / "best.yaml").write_text("x: 1")
    assert jobs.submit(head, load("demo"), ["--params", str(tmp_path / "best.yaml"), "--seeds", "2"], "n") == "job"
    assert "sweep space.yaml --params best.yaml --seeds 2 --address auto" in head.entrypoint
    assert head.space == load("demo")
    assert {"trainables", "search_spaces", "orchestrator", "dashboards", "deltatune", "best.yaml"} <= set(head.files)
    assert not any(path.exists() for path in head.files.values()), "what was sent is cleaned up"


@pytest.mark.cluster
@pytest.mark.slow
def test_a_joined_sweep_survives_a_node_and_keeps_no_checkpoints_in_a_folder_that_another_node_does_not_see(
    calm: Path, tmp_path: Path, cluster: Cluster
) -> None:
    storage = tmp_path / "storage"
    storage.mkdir()
    cluster.grow(2, within=with_a_disk_of_its_own(storage))
    shell = submit(cluster, tmp_path / "space.yaml", storage)
    assert (shell.returncode, shell.stdout) == (2, "")
    blind = socket.gethostname()
    assert shell.stderr.startswith(f"error: {storage} is not one folder for all nodes ({blind} cannot see")
    assert len(shell.stderr.splitlines()) == 1
    assert not any(storage.iterdir()), "nothing has begun"
    with driver(storage, "--no-mlflow", "--address", cluster.address, env=TOKEN, **LONGER) as process:
        wait_for(ended(storage, 5), process)
        cluster.remove(cluster.nodes.pop())
        out, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, err
    assert f"no checkpoints: {blind} cannot see" in out
    assert "a worker was lost: " in out
    assert_same(storage, calm)


@pytest.mark.cluster
@pytest.mark.slow
def test_a_submitted_sweep_survives_its_shell_and_a_node(calm: Path, tmp_path: Path, cluster: Cluster) -> None:
    cluster.grow(2)
    shell = submit(cluster, tmp_path / "space.yaml", tmp_path, **LONGER)
    assert shell.returncode == 0, shell.stderr
    assert "runs the sweep small" in shell.stdout
    wait_for(ended(tmp_path, 5))
    assert "process " in str(driver_of(tmp_path / "small"))
    cluster.remove(cluster.nodes.pop())
    code, said, err = command("watch", "small", "--storage", str(tmp_path))
    assert code == 0, err
    assert said.strip().endswith("small: 32 cells done, 0 failed")
    assert_same(tmp_path, calm)
    _, log, _ = command("logs", "small", "--storage", str(tmp_path))
    assert "transfer: 28 cells to run" in log
    assert "a worker was lost: " in log


ON_A_NODE = f"""
from deltatune.cli.main import main
from orchestrator.cluster import connection
from ray._private import services

connection.HEAD_PATIENCE = 3.0
find = services.get_node_to_connect_for_driver
services.get_node_to_connect_for_driver = lambda gcs, **which: find(gcs, **which | {{"node_ip_address": "{NODES}"}})
main()
"""
"""A driver that joins the cluster from another machine than the head's: Ray ends it at once if its own node is lost."""


@pytest.mark.cluster
@pytest.mark.slow
def test_a_joined_sweep_is_told_of_the_loss_of_its_head(calm: Path, tmp_path: Path, cluster: Cluster) -> None:
    cluster.grow(1)
    words = ("--no-mlflow", "--address", cluster.address)
    with driver(tmp_path, *words, python=("-c", ON_A_NODE), env=TOKEN, **LONGER) as process:
        wait_for(ended(tmp_path, 3), process)
        cluster.remove(cluster.head)
        _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 1
    assert "error: the head of the Ray cluster at " in err
    assert f":{cluster.port} is gone; finished cells are kept, the same command continues" in err
    there = len(Results.open(tmp_path, "small").heads())
    _, tally = sweep(tmp_path, **LONGER)
    assert tally.reused == there >= 3
    assert_same(tmp_path, calm)
