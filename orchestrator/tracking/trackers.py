"""The kinds of tracker, as data, by the scheme of a tracking URI. Light to import."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from orchestrator.results.lock import Hold, writing_to

if TYPE_CHECKING:
    from orchestrator.tracking.backend import TrackingBackend


@dataclass(frozen=True)
class TrackerKind:
    """One kind of tracker."""

    key: str
    """Its name in the files of a lock."""
    title: str
    """Its name in messages."""
    schemes: tuple[str, ...]
    """The schemes of its URIs."""
    backend: str
    """'module:Class' of its TrackingBackend, imported when a sweep is written."""
    check: str = ""
    """'module:function' that raises InputError for a URI of its schemes that it cannot use."""
    watch: str = ""
    """'module:function' that logs the machine's load to a copy (uri, its name), and returns what stops it."""
    has_registry: bool = False
    """Whether trained sources can be registered there, and `deltatune ui` shows it."""

    def load(self) -> type[TrackingBackend]:
        """Import the backend."""
        return cast("type[TrackingBackend]", _named(self.backend))

    def watched(self, uri: str, parent: str) -> Callable[[], None]:
        """Begin to log the machine's load to a copy, if that is asked for; return what stops it."""
        stop: Callable[[], None] = _named(self.watch)(uri, parent) if self.watch else lambda: None
        return stop

    def checked(self, uri: str) -> str:
        """Return the URI. Raises InputError for one that cannot be used."""
        if self.check:
            _named(self.check)(uri)
        return uri

    @contextmanager
    def held(self, folder: Path) -> Iterator[Hold]:
        """Hold the lock for writing the sweep in `folder` there. Raises InputError, which names the present holder."""
        with writing_to(folder, self.key, self.title) as hold:
            yield hold


MLFLOW = TrackerKind(
    "mlflow",
    "MLflow",
    ("sqlite", "postgresql", "mysql", "mssql", "http", "https", "databricks"),
    "orchestrator.tracking.mlflow.mirror:Mirror",
    watch="orchestrator.tracking.mlflow.system_metrics:watch",
    has_registry=True,
)

TRACKERS: tuple[TrackerKind, ...] = (
    MLFLOW,
    TrackerKind(
        "jsonl",
        "the JSON lines",
        ("jsonl",),
        "orchestrator.tracking.json_lines:JsonLines",
        check="orchestrator.tracking.json_lines:check",
    ),
)


def scheme(uri: str) -> str:
    """Return a URI's scheme, without the driver of a database (mysql+pymysql)."""
    return uri.partition(":")[0].split("+")[0].lower()


def tracker_of(uri: str) -> TrackerKind | None:
    """Return the kind of tracker of a URI, or None."""
    return next((kind for kind in TRACKERS if scheme(uri) in kind.schemes), None)


def kind_of(uri: str) -> TrackerKind:
    """Return the same for a URI that was checked before."""
    return tracker_of(uri) or MLFLOW


def without_registry(uri: str) -> str:
    """Return a sentence for a tracker that has no registry of trained sources; empty for one that has."""
    kind = kind_of(uri)
    if kind.has_registry:
        return ""
    return f"only MLflow has a registry of trained sources, not {kind.title} ({uri})"


def _named(text: str) -> Any:
    module, _, name = text.partition(":")
    return getattr(import_module(module), name)
