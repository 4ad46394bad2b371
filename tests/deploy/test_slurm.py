"""The Slurm script, run with stand-ins for Slurm, Ray and deltatune that write down how they are called."""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

SCRIPT = Path(__file__).parents[2] / "deploy/slurm.sh"
NODES = 3
STAND_INS = {
    "scontrol": '[[ $1 != show ]] || printf "n1\\nn2\\nn3\\n"',
    "ray": "",
    # A step of Ray ends when it is told to; any other one answers at once.
    "srun": 'if [[ $* == *hostname* ]]; then echo "10.0.0.1 192.168.0.1 "; exit; fi\n'
    'trap \'echo "srun ended" >>"$CALLS"; exit 0\' TERM\nwhile :; do sleep .05; done',
    # Waits for the nodes, as the real one does.
    "python": 'cat >/dev/null\n[[ $JOINS == yes ]] || { trap "exit 1" TERM; while :; do sleep .05; done; }\n'
    'until (($(grep -c "ray start" "$CALLS") == $3)); do sleep .02; done',
    "deltatune": '[[ $SWEEP == works ]] || exit "$SWEEP"\n'
    'trap \'echo "deltatune stopped" >>"$CALLS"; sleep .2; exit 130\' TERM\nwhile :; do sleep .05; done',
}


class Job:
    """One run of the script with stand-ins in a folder of its own."""

    def __init__(
        self, folder: Path, *arguments: str, stand_ins: Mapping[str, str] = STAND_INS, **environment: str
    ) -> None:
        programs = folder / "venv/bin"
        programs.mkdir(parents=True, exist_ok=True)
        for name, body in stand_ins.items():
            (programs / name).write_text(f'#!/usr/bin/env bash\necho "{name} $*" >>"$CALLS"\n{body}\n')
            (programs / name).chmod(0o755)
        self._calls = folder / "calls"
        self._calls.touch()
        given = {
            "PATH": os.environ["PATH"],
            "CALLS": str(self._calls),
            "VENV": str(programs.parent),
            "STORAGE": "/shared/results",
            "JOINS": "yes",
            "SWEEP": "0",
            "SLURM_JOB_ID": "42",
            "SLURM_JOB_NODELIST": "n[1-3]",
            "SLURM_CPUS_PER_TASK": "16",
            "SLURM_SUBMIT_DIR": str(folder),
        }
        self._process = subprocess.Popen(
            ["bash", str(SCRIPT), *arguments], env=given | environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )

    def calls(self) -> list[str]:
        return self._calls.read_text().splitlines()

    def wait_for(self, beginning: str) -> None:
        end = time.monotonic() + 30
        while not any(call.startswith(beginning) for call in self.calls()):
            assert time.monotonic() < end, self.calls()
            time.sleep(0.02)

    def send(self, number: signal.Signals) -> None:
        self._process.send_signal(number)

    def end(self) -> tuple[int, str]:
        """Exit code and what it said."""
        said, complained = self._process.communicate(timeout=240)
        return self._process.returncode, said.decode() + complained.decode()

    def stop(self) -> None:
        """End it if a test that has failed left it running."""
        if self._process.poll() is None:
            self.send(signal.SIGTERM)
            self.end()


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Job]]:
    jobs: list[Job] = []

    def started(*arguments: str, **options: Any) -> Job:
        jobs.append(Job(tmp_path, *arguments, **options))
        return jobs[-1]

    yield started
    for job in jobs:
        job.stop()


def test_a_sweep_runs_on_a_head_and_workers_that_have_all_joined(start: Callable[..., Job]) -> None:
    job = start("paper-table1", "--tracking-uri", "https://mlflow.example.org")
    assert job.end()[0] == 0
    step = "srun --nodes=1 --ntasks=1 --cpus-per-task=16 --overlap --nodelist="
    ray = "ray start --block --num-cpus=16 --temp-dir=/tmp/ray-42 --disable-usage-stats"
    calls = job.calls()
    assert calls[:3] == ["ray get-auth-token --generate", "scontrol show hostnames n[1-3]", f"{step}n1 hostname -I"]
    assert sorted(call for call in calls if "ray start" in call) == [
        f"{step}n1 {ray} --head --node-ip-address=10.0.0.1 --port=6379 --include-dashboard=false",
        f"{step}n2 {ray} --address=10.0.0.1:6379",
        f"{step}n3 {ray} --address=10.0.0.1:6379",
    ]
    sweep = calls.index(
        "deltatune sweep paper-table1 --tracking-uri https://mlflow.example.org"
        " --address 10.0.0.1:6379 --storage /shared/results"
    )
    assert calls.index("python - 10.0.0.1:6379 3 300") < sweep
    assert all(calls.index(call) < sweep for call in calls if "ray start" in call)
    assert calls[sweep + 1 :] == ["srun ended"] * NODES


def test_when_time_is_nearly_up_the_sweep_stops_in_order_and_the_job_queues_again(start: Callable[..., Job]) -> None:
    job = start("demo", SWEEP="works")
    job.wait_for("deltatune sweep")
    job.send(signal.SIGUSR1)
    assert job.end()[0] == 0
    after = job.calls()[-NODES - 2 :]
    assert after == ["deltatune stopped", "scontrol requeue 42", *["srun ended"] * NODES]


def test_a_cancelled_sweep_stops_in_order_and_never_queues_again(start: Callable[..., Job]) -> None:
    job = start("demo", SWEEP="works")
    job.wait_for("deltatune sweep")
    job.send(signal.SIGTERM)
    assert job.end()[0] == 130
    assert job.calls()[-NODES - 1 :] == ["deltatune stopped", *["srun ended"] * NODES]


@pytest.mark.parametrize(("number", "code", "again"), [(signal.SIGUSR1, 0, True), (signal.SIGTERM, 143, False)])
def test_a_signal_while_nodes_are_still_joining(
    start: Callable[..., Job], number: signal.Signals, code: int, again: bool
) -> None:
    job = start("demo", JOINS="no")
    job.wait_for("python")
    job.send(number)
    assert job.end()[0] == code
    assert ("scontrol requeue 42" in job.calls()) is again
    assert not [call for call in job.calls() if call.startswith("deltatune")]


def test_the_exit_code_is_the_sweeps(start: Callable[..., Job]) -> None:
    job = start("demo", SWEEP="2")
    assert job.end()[0] == 2
    assert job.calls().count("srun ended") == NODES
    assert not [call for call in job.calls() if "requeue" in call]


@pytest.mark.parametrize(
    ("arguments", "environment", "says"),
    [(["demo"], {"STORAGE": ""}, "set STORAGE"), ([], {}, "which search space?")],
)
def test_what_is_missing_is_said_before_any_work(
    start: Callable[..., Job], arguments: list[str], environment: dict[str, str], says: str
) -> None:
    job = start(*arguments, **environment)
    code, said = job.end()
    assert code != 0
    assert says in said
    assert job.calls() == []


def test_slurm_is_told_to_warn_to_requeue_and_to_outlive_a_node() -> None:
    asked = re.findall(r"^#SBATCH (--\S+)", SCRIPT.read_text(), re.MULTILINE)
    assert {"--signal=B:USR1@120", "--requeue", "--no-kill", "--open-mode=append"} <= set(asked)


def test_the_wait_counts_the_nodes_that_live(ray_session: None) -> None:
    import ray

    found = re.search(r"<<'PY' &\n(.*?)\nPY\n", SCRIPT.read_text(), re.DOTALL)
    assert found is not None
    address = ray.get_runtime_context().gcs_address

    def wait(nodes: str, seconds: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-", address, nodes, seconds]
        env = os.environ | {"RAY_AUTH_MODE": "token"}
        return subprocess.run(command, input=found[1], env=env, capture_output=True, text=True, timeout=120)

    assert wait("1", "60").returncode == 0
    short = wait("2", "0.5")
    assert short.returncode == 1
    assert "error: 1 of 2 nodes have joined Ray within 0 s" in short.stderr


@pytest.mark.slow
def test_on_real_ray_a_requeued_job_goes_on_where_it_stopped(start: Callable[..., Job], tmp_path: Path) -> None:
    """Two nodes on this machine; only Slurm is a stand-in."""
    local = {
        "scontrol": '[[ $1 != show ]] || printf "n1\\nn2\\n"',
        "srun": 'while [[ $1 == --* ]]; do shift; done\nexec "$@"',
    }
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    environment = {
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "PYTHONPATH": str(SCRIPT.parents[1]),
        "HOME": str(tmp_path),
        "STORAGE": str(tmp_path / "results"),
        "SLURM_JOB_ID": str(os.getpid()),
        "SLURM_CPUS_PER_TASK": "1",
        "HEAD_IP": "127.0.0.1",
        "RAY_PORT": port,
    }
    sweep = ["demo", "--no-mlflow", "--set", "episodes=100000", "--seeds", "1", "--agents", "q_learning"]
    sweep += ["--checkpoint-every", "0.2"]
    try:
        job = start(*sweep, stand_ins=local, **environment)
        end = time.monotonic() + 120
        while not list(tmp_path.glob("results/demo/checkpoints/*.checkpoint")) and time.monotonic() < end:
            time.sleep(0.1)
        job.send(signal.SIGUSR1)
        code, said = job.end()
        assert (code, "out of time" in said) == (0, True), said
        assert job.calls()[-1].startswith("scontrol requeue")
        code, said = start(*sweep, stand_ins=local, **environment).end()
        assert (code, "0 failed" in said) == (0, True), said
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.1", int(port)), timeout=2)
    finally:
        shutil.rmtree(f"/tmp/ray-{os.getpid()}", ignore_errors=True)


@pytest.mark.skipif(shutil.which("shellcheck") is None, reason="shellcheck is not installed")
def test_shellcheck_finds_nothing() -> None:
    done = subprocess.run(["shellcheck", str(SCRIPT)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_bash_can_read_the_script() -> None:
    assert subprocess.run(["bash", "-n", str(SCRIPT)]).returncode == 0
    assert os.access(SCRIPT, os.X_OK)
