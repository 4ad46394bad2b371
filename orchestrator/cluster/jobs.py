"""A sweep as a Ray job, which runs on a cluster after the shell that submitted it has ended."""

from __future__ import annotations

import json
import logging
import shlex
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlparse

import yaml

from orchestrator.cluster.connection import stage_code, unreachable
from orchestrator.errors import SweepError
from search_spaces.search_space import SearchSpace
from trainables.errors import InputError
from trainables.plugins.loader import packed

SPACE_FILE = "space.yaml"
"""The file of the search space, next to the code of the job."""

FILE_OPTIONS = ("--params", "--source", "--file")
"""Options of `sweep` whose value may be a file."""

ASK_SECONDS = 180.0
"""Seconds in which the cluster must report whether its nodes can read the storage."""


def client(address: str) -> Any:
    """Return a client of the head at `address`. Raises InputError for another address, or where nothing answers."""
    parts = urlparse(address)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise InputError(f"a head that takes jobs has an address like http://HOST:8265 (got '{address}')")
    if why := unreachable(parts.hostname, parts.port or (443 if parts.scheme == "https" else 80)):
        raise InputError(f"no Ray head takes jobs at '{address}': {why}")
    try:
        from ray.job_submission import JobSubmissionClient

        for name in ("ray", "ray.dashboard.modules.dashboard_sdk"):  # silence their lines on uploaded packages
            logging.getLogger(name).setLevel(logging.WARNING)
        return JobSubmissionClient(address)
    except (ImportError, RuntimeError, ConnectionError) as error:
        text = str(error).strip().split("\n")[0]
        raise InputError(f"no job can be sent to '{address}': {text} (it needs deltatune[cluster])") from None


def submit(head: Any, space: SearchSpace, words: Sequence[str], name: str) -> str:
    """Submit `deltatune sweep` with `words`, the search space and the files that they name; return the job's id."""
    text = yaml.safe_dump(space.to_json(), sort_keys=False)
    files = {SPACE_FILE: text.encode()}
    for key, source in packed().items():
        file = key.partition("@")[0]
        if key not in text:
            continue
        if file in files:
            raise InputError(f"two files called {file} cannot go to a cluster together: rename one of them")
        files[file] = source
    words = list(_as_sent(words, files))
    entrypoint = shlex.join(["python", "-m", "deltatune.cli.main", "sweep", SPACE_FILE, *words, "--address", "auto"])
    with _package(files) as folder:
        return _send(head, entrypoint, folder, {"deltatune_sweep": name})


def _as_sent(words: Sequence[str], files: dict[str, bytes]) -> Iterator[str]:
    """Yield the arguments as the job will read them; the files that options name are added to `files`."""
    before = ""
    for word in words:
        option, equals, value = word.partition("=")
        if option in FILE_OPTIONS and equals:
            yield f"{option}={_sent(value, files)}"
        else:
            yield _sent(word, files) if before in FILE_OPTIONS else word
        before = word


def _sent(word: str, files: dict[str, bytes]) -> str:
    """Return the unique name under which the file `word` is sent; `word` itself if it is no file."""
    path = Path(word)
    if not path.is_file():
        return word
    data = path.read_bytes()
    names = (path.name, *(f"{number}-{path.name}" for number in range(2, len(files) + 3)))
    name = next(name for name in names if files.get(name, data) == data)
    files[name] = data
    return name


def check_storage(head: Any, storage: str) -> None:
    """Ask the cluster whether all its nodes can read the storage. Raises InputError, which names those that cannot."""
    with _package({}) as folder:
        entrypoint = shlex.join(["python", "-m", "orchestrator.cluster.jobs", storage])
        job = _send(head, entrypoint, folder, {})
        deadline = time.monotonic() + ASK_SECONDS
        while not (status := head.get_job_status(job)).is_terminal():
            if time.monotonic() > deadline:
                head.stop_job(job)
                raise SweepError(f"the cluster did not report within {ASK_SECONDS:.0f} s whether it can read {storage}")
            time.sleep(0.5)
    said = [line[len(_MARK) :] for line in head.get_job_logs(job).splitlines() if line.startswith(_MARK)]
    if not said:
        raise SweepError(f"the cluster could not be queried about {storage}: its job ended as {status.value}")
    answer: dict[str, Any] = json.loads(said[-1])
    if "error" in answer:
        raise InputError(f"the cluster cannot use {storage}: {answer['error']}")
    if answer["blind"]:
        nodes = ", ".join(answer["blind"])
        raise InputError(
            f"{storage} is not one folder for all nodes ({nodes} cannot see what the head writes there): "
            "take a shared folder, or a URL such as s3://BUCKET/FOLDER"
        )


def _send(head: Any, entrypoint: str, folder: Path, metadata: dict[str, str]) -> str:
    """Submit a job; a head that has just started refuses jobs for a while."""
    deadline = time.monotonic() + HEAD_STARTUP_TIMEOUT
    while True:
        try:
            env = {"working_dir": str(folder)}
            return str(head.submit_job(entrypoint=entrypoint, runtime_env=env, metadata=metadata))
        except RuntimeError as error:
            text = str(error).strip().splitlines()[-1]
            if "No available agent" not in text or time.monotonic() > deadline:
                raise SweepError(f"the cluster does not take the job: {text}") from None
            time.sleep(1.0)


_MARK = "deltatune-storage "


HEAD_STARTUP_TIMEOUT = 60.0
"""Seconds to wait for a new head to accept jobs."""


@contextmanager
def _package(files: dict[str, bytes]) -> Iterator[Path]:
    """Yield a folder with this code and some files."""
    folder = stage_code(Path(tempfile.mkdtemp(prefix="deltatune-job-")))
    try:
        for name, data in files.items():
            (folder / name).write_bytes(data)
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _answer(storage: str) -> dict[str, Any]:
    """Return, on the cluster, the nodes that cannot read the storage."""
    import ray

    from orchestrator.cluster.nodes import nodes_without_storage
    from trainables.storage.folders import make_folder
    from trainables.storage.paths import storage_path

    try:
        folder = make_folder(storage_path(storage))
        ray.init(address="auto", log_to_driver=False, logging_level=logging.ERROR)
        return {"blind": nodes_without_storage(folder)}
    except InputError as error:
        return {"error": str(error)}


if __name__ == "__main__":
    print(_MARK + json.dumps(_answer(sys.argv[1])), flush=True)
