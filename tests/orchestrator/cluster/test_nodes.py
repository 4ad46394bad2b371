"""What nodes are asked: whether they see a folder."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import ray

from orchestrator.cluster import nodes


class Node(NamedTuple):
    """A stand-in for a node of a cluster, and what it answers when it is asked to read a file."""

    host: str
    answer: Callable[[Path], bool]


def seen(path: Path) -> bool:
    return path.exists()


def refused(path: Path) -> bool:
    raise ray.exceptions.RayTaskError("_sees", "", PermissionError(13, "Permission denied"))


def gone(path: Path) -> bool:
    raise ray.exceptions.NodeDiedError("the node is gone")


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Have these nodes."""

    def have(*there: Node) -> None:
        monkeypatch.setattr(nodes, "nodes", lambda: [(node.host, node.host) for node in there])
        by_name = {node.host: node for node in there}
        monkeypatch.setattr(nodes, "_on", lambda name, function: Asked(by_name[name]))
        monkeypatch.setattr(ray, "wait", lambda *words, **more: None)
        monkeypatch.setattr(ray, "get", lambda answer, timeout: answer())

    return have


class Asked(NamedTuple):
    """A question to a node, answered when it is asked for."""

    node: Node

    def remote(self, path: str, token: str) -> Any:
        mode = Path(path).stat().st_mode
        assert mode & 0o044 == 0o044, "a node may run under another user"
        assert Path(path).read_text() == token

        def answer() -> bool:
            return self.node.answer(Path(path))

        return answer


def test_a_node_that_cannot_read_is_blind_and_one_that_dies_says_nothing(
    tmp_path: Path, cluster: Callable[..., None]
) -> None:
    cluster(Node("head", seen), Node("other-user", refused), Node("dying", gone), Node("elsewhere", lambda path: False))
    assert nodes.nodes_without_storage(tmp_path) == ["other-user", "elsewhere"]


def test_a_probe_leaves_neither_a_file_nor_an_open_descriptor(tmp_path: Path, cluster: Callable[..., None]) -> None:
    cluster(Node("head", seen), Node("other", seen))
    before = len(os.listdir("/proc/self/fd"))
    assert nodes.nodes_without_storage(tmp_path) == []
    assert len(os.listdir("/proc/self/fd")) == before
    assert not list(tmp_path.iterdir())
