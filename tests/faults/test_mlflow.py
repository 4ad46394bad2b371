"""MLflow is away: the sweep does not notice, says so at its end, and `sync` makes good for it."""

from __future__ import annotations

import base64
import contextlib
import http.server
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import requests
import yaml
from conftest import CELLS, GROUPS, LOCAL, SPACE
from harness import assert_same
from mlflow.tracking import MlflowClient

from benchmarks.tracking.server import TrackingServer
from orchestrator.analysis.findings import find
from orchestrator.results.records.record import Record
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking import tracker
from orchestrator.tracking.sync import sync
from orchestrator.tracking.tracker import Tracker
from tests.deltatune.cli.in_process import command
from trainables.cell import content_id


def kinds(server: TrackingServer, results: Results) -> Counter[str]:
    """How many finished runs there are of each kind."""
    client = MlflowClient(server.uri)
    experiment = client.get_experiment_by_name("deltatune/tests")
    assert experiment is not None
    sweep_id = content_id([results.name, results.meta()["created"]])
    found = client.search_runs([experiment.experiment_id], f"tags.sweep_id = '{sweep_id}'", max_results=1000)
    assert {run.info.status for run in found} == {"FINISHED"}
    assert len(
        {(run.data.tags["kind"], run.data.tags.get("cell_id"), run.data.tags.get("group")) for run in found}
    ) == len(found)
    return Counter(run.data.tags["kind"] for run in found)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TrackingServer]:
    server = TrackingServer(tmp_path_factory.mktemp("server"))
    server.start()
    yield server
    server.kill()


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracker, "FIRST_PAUSE", 0.2)


ALL = {"cell": CELLS, "aggregate": GROUPS, "sweep": 1}


def tracked(storage: Path, uri: str, harm: Callable[[int], None] = lambda cells: None) -> tuple[Results, Tracker]:
    """A sweep that is tracked, with something done to MLflow after each cell."""
    from rich.console import Console

    from orchestrator.execution.sweep import run
    from search_spaces.loading import parse

    results = Results.create(storage, "small", parse("small", SPACE))
    follower = Tracker(results, uri)
    seen = 0

    def told(stage: str, record: Record) -> None:
        nonlocal seen
        seen += 1
        harm(seen)
        follower.record(stage, record)

    assert run(results, LOCAL, Console(quiet=True), told).failed == 0
    return results, follower


@contextlib.contextmanager
def proxy(server: TrackingServer, secret: str = "") -> Iterator[str]:
    """The address of a proxy to the server, until the end of the context; with a secret, for those who know it."""
    ticket = f"Basic {base64.b64encode(f'ada:{secret}'.encode()).decode()}"

    class Gate(http.server.BaseHTTPRequestHandler):
        def answer(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            if secret and self.headers.get("Authorization") != ticket:
                return self.reply(401, b"Who are you?")
            passed = {"Content-Type": self.headers.get("Content-Type", "")}
            answer = requests.request(self.command, server.uri + self.path, data=body, headers=passed, timeout=60)
            return self.reply(answer.status_code, answer.content)

        def __getattr__(self, name: str) -> Callable[[], None]:
            if name.startswith("do_"):
                return self.answer
            raise AttributeError(name)

        def reply(self, status: int, body: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            """Not a word."""

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Gate) as door:
        threading.Thread(target=door.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{door.server_port}"
        door.shutdown()


@pytest.mark.slow
def test_a_server_that_is_killed_and_comes_back_has_everything(
    server: TrackingServer, finished: Path, tmp_path: Path
) -> None:
    def harm(cells: int) -> None:
        if cells == 10:
            server.kill()
        if cells == 20:
            server.start()

    results, follower = tracked(tmp_path, server.uri, harm)
    assert follower.finish(find(results), []) is not None
    assert follower.error is None
    assert kinds(server, results) == ALL
    assert_same(tmp_path, finished)


@pytest.mark.slow
def test_a_server_that_is_gone_for_the_rest_of_the_sweep_is_made_good_for_by_sync(
    server: TrackingServer, tmp_path: Path
) -> None:
    with contextlib.ExitStack() as connection:
        uri = connection.enter_context(proxy(server))
        results, follower = tracked(tmp_path, uri, lambda cells: connection.close() if cells == 10 else None)
        assert follower.finish(find(results), []) is None
        assert follower.error is not None
    for _ in range(2):
        sync(find(results), server.uri, [])
        assert kinds(server, results) == ALL


def test_a_store_that_is_down_from_the_start_never_holds_a_sweep_up(finished: Path, tmp_path: Path) -> None:
    started = time.monotonic()
    results, follower = tracked(tmp_path, "http://127.0.0.1:9")
    assert follower.finish(find(results), []) is None
    assert time.monotonic() - started < 200
    assert_same(tmp_path, finished)


def test_a_queue_that_is_full_is_caught_up_with_at_the_end(
    finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tracker, "WAITING", 1)
    import shutil

    shutil.copytree(finished, tmp_path / "copy")
    results = Results.open(tmp_path / "copy", "small")
    follower = Tracker(results, f"sqlite:///{tmp_path}/mlflow.db")
    for stage, _, record in results.records():
        assert record is not None
        follower.record(stage, record)
    assert follower.finish(find(results), []) is not None
    client = MlflowClient(follower.uri)
    experiment = client.get_experiment_by_name("deltatune/tests")
    assert experiment is not None
    runs = client.search_runs([experiment.experiment_id], max_results=1000)
    assert Counter(run.data.tags["kind"] for run in runs) == ALL


SECRET = "Tr0ub4dor-and-3"


@pytest.mark.slow
@pytest.mark.usefixtures("quick_figures")
def test_a_password_opens_the_server_and_is_written_nowhere(
    server: TrackingServer, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    storage = tmp_path / "storage"
    storage.mkdir()
    (file := tmp_path / "space.yaml").write_text(yaml.safe_dump(SPACE))
    monkeypatch.setenv("MLFLOW_TRACKING_USERNAME", "ada")
    with proxy(server, SECRET) as uri:
        monkeypatch.setenv("MLFLOW_TRACKING_PASSWORD", SECRET)
        words = ["--local", "--workers", "1", "--tracking-uri", uri, "--agents", "q_learning"]
        code, out, err = command("sweep", str(file), "--storage", str(storage), *words)
        monkeypatch.setenv("MLFLOW_TRACKING_PASSWORD", f"not-{SECRET}")
        results = Results.open(storage, "small")
        stranger = Tracker(results, uri)
        assert stranger.finish(find(results), []) is None
    assert code == 0, err
    assert "MLflow is incomplete" not in out
    assert kinds(server, results)["cell"] == len(results.heads()) > 0
    assert "Who are you?" in str(stranger.error)
    said = [out, err, str(stranger.error), *capfd.readouterr()]
    files = [path for folder in (storage, server.folder) for path in folder.rglob("*") if path.is_file()]
    assert len(files) > 5
    for word in (SECRET, base64.b64encode(f"ada:{SECRET}".encode()).decode()):
        assert not [text for text in said if word in text]
        assert not [path for path in files if word.encode() in path.read_bytes()]
