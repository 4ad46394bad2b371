"""Running a sweep from Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from rich.console import Console

from dashboards.renderers.drawing_process import DrawingProcess
from deltatune.publish import Publication
from deltatune.publish import load as load_renderers
from deltatune.sweep_results import SweepResults
from orchestrator.errors import InterruptedSweepError
from orchestrator.execution.defaults import KEEP_STATES, Reuse
from orchestrator.execution.session import SweepSession
from orchestrator.execution.settings import Settings
from orchestrator.planning.evaluations import few_evaluations_in
from orchestrator.tracking.uri import tracking_uri as store_uri
from search_spaces.loading import load, parse
from search_spaces.narrow import narrow
from search_spaces.search_space import SearchSpace
from trainables.storage.paths import default_storage, storage_path


def sweep(
    space: str | Path | Mapping[str, Any] | SearchSpace,
    *,
    name: str | None = None,
    storage: str | Path | None = None,
    tasks: Sequence[str] = (),
    agents: Sequence[str] = (),
    seeds: int | Literal["auto"] | None = None,
    confirm: int | None = None,
    hyperparameters: Mapping[str, Any] | None = None,
    workers: int | None = None,
    address: str | None = None,
    local: bool = False,
    retry_failed: bool = False,
    reuse: Reuse = "all",
    keep_states: float = KEEP_STATES,
    mlflow: bool = True,
    tracking_uri: str | None = None,
    progress: bool = True,
) -> SweepResults:
    """Run a sweep as `deltatune sweep` does, and return its results; finished cells do not run again.

    space: a built-in search space's name, a YAML file, a mapping of the same keys, or a SearchSpace. The other
    arguments are the command's options: name and storage say where the results are; tasks, agents, seeds and
    hyperparameters narrow the space (seeds "auto": as many as a sequential test asks for); confirm runs what is
    selected again on so many unseen seeds; workers, address and local say where cells run; reuse says what is taken
    from other sweeps of the storage; keep_states says how many gigabytes the end states of a stage's cells may take,
    from which more episodes continue. progress: whether to show it.
    Raises InputError for bad input, before any work; SweepError for one that stopped (finished cells are kept).
    """
    folder = storage_path(storage or default_storage())
    fixed = dict(hyperparameters or {})
    chosen = narrow(_space(space), tasks=tasks, agents=agents, seeds=seeds, confirm=confirm, hyperparameters=fixed)
    settings = Settings(
        workers=workers, address=address, local=local, retry_failed=retry_failed, reuse=reuse, keep_states=keep_states
    )
    uri = store_uri(folder, tracking_uri) if mlflow else None
    console = Console(stderr=True, quiet=not progress, highlight=False, markup=False)
    if said := few_evaluations_in(chosen):
        console.print(said, style="yellow", soft_wrap=True)
    name = chosen.name if name is None else name
    opened = SweepSession.open(folder, name, chosen, tracking_uri=uri, console=console)
    with opened as session, DrawingProcess() as artist:
        return _run(session, settings, artist)


def _run(session: SweepSession, settings: Settings, artist: DrawingProcess) -> SweepResults:
    """Run the missing cells of a sweep and publish it. Raises InterruptedSweepError where cells are left."""
    if session.run(settings, meanwhile=lambda: load_renderers(artist)).left:
        raise InterruptedSweepError(f"the sweep {session.results.name} was interrupted: call it again to continue")
    publication = Publication(session.results, artist)
    session.finish(publication.findings, publication.artifacts())
    publication.published()
    return SweepResults(session.results)


def _space(space: str | Path | Mapping[str, Any] | SearchSpace) -> SearchSpace:
    """Return `space` as a SearchSpace. Raises InputError for what is none."""
    if isinstance(space, SearchSpace):
        return space
    if isinstance(space, Mapping):
        return parse("the search space", dict(space), (Path(),))
    return load(str(space))
