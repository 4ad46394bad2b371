"""The command that runs a sweep."""

from __future__ import annotations

from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from deltatune.cli import options as opt
from deltatune.cli.app import (
    RESULTS,
    RUN_PANEL,
    Files,
    Json,
    Storage,
    TrackingUri,
    app,
    err,
    load_files,
    progress_console,
)
from orchestrator.execution.defaults import CHECKPOINT_SECONDS, KEEP_STATES

if TYPE_CHECKING:
    from dashboards.renderers.drawing_process import DrawingProcess
    from orchestrator.execution.session import SweepSession
    from orchestrator.execution.settings import Settings
    from orchestrator.model_registry.pretrained import Pretrained
    from orchestrator.planning.arms import Params
    from orchestrator.planning.source_choice import Runs
    from search_spaces.search_space import SearchSpace


@app.command(rich_help_panel=RUN_PANEL)
def sweep(
    context: typer.Context,
    space: opt.Space = None,
    name: opt.NewName = None,
    storage: Storage = RESULTS,
    task: opt.Targets = None,
    agent: opt.Agents = None,
    seeds: opt.Seeds = None,
    confirm: opt.Confirm = None,
    settings: opt.Set = None,
    params: opt.Params = None,
    source: opt.Pretrained = None,
    file: Files = None,
    workers: opt.Workers = None,
    address: opt.Address = None,
    local: opt.Local = False,
    retry_failed: opt.RetryFailed = False,
    reuse: opt.Reuse = "all",
    checkpoint_every: opt.CheckpointEvery = CHECKPOINT_SECONDS,
    keep_states: opt.KeepStates = KEEP_STATES,
    time_limit: opt.TimeLimit = None,
    cpus_per_cell: opt.Cpus = 1.0,
    gpus_per_cell: opt.Gpus = 0.0,
    memory_per_cell: opt.Memory = 0.0,
    dry_run: opt.DryRun = False,
    mlflow: opt.Mlflow = True,
    tracking_uri: TrackingUri = None,
    as_json: Json = False,
) -> None:
    """Run a search space: train the sources, then every agent on every target, and compare.

    The same command again continues an interrupted sweep, and runs the cells that an extended search space adds; no
    finished cell runs twice, and one that another sweep of the storage has finished is copied (see --reuse). With
    --name alone, a sweep continues with the search space of its last run. Try `deltatune sweep demo`, or a small
    `deltatune sweep demo --seeds 2 --set episodes=2000 --name try`.
    """
    from deltatune.cli.space_argument import space_of
    from orchestrator.results.sweep_folder import check_name
    from search_spaces.narrow import narrow

    if name is not None:
        check_name(name)
    load_files(file)
    fixed = _settings(settings or [])
    chosen = narrow(
        space_of(space, storage, name),
        tasks=task or (),
        agents=agent or (),
        seeds=_seeds(seeds),
        confirm=confirm,
        hyperparameters=fixed,
    )
    name, console = check_name(name or chosen.name), progress_console(context, as_json)
    with console.status(_summary(name, chosen)):
        _prepare(address)
        from orchestrator.cluster.resources import Resources
        from orchestrator.execution.session import SweepSession
        from orchestrator.execution.settings import Settings

        settled = _settled(params)
        sources, runs = _pretrained(source, chosen, storage, tracking_uri)
        uri = _store(storage, tracking_uri) if mlflow else None
    _warn(chosen, params, settled)
    how = Settings(
        workers=workers,
        address=address,
        local=local,
        retry_failed=retry_failed,
        reuse=reuse,
        checkpoint_seconds=checkpoint_every,
        keep_states=keep_states,
        time_limit=time_limit,
        resources=Resources(cpus_per_cell, gpus_per_cell, memory_per_cell),
        params=settled,
        pretrained=runs,
    )
    if local:
        _check_local(how)
    if dry_run:
        _forecast(chosen, how, storage / name, as_json)
    else:
        opened = SweepSession.open(storage, name, chosen, sources=sources, tracking_uri=uri, console=console)
        _run(opened, how, as_json)


def _prepare(address: str | None) -> None:
    """Set the environment variables of Ray and MLflow, before either is imported."""
    from orchestrator.process_env import prepare

    prepare(joins_cluster=address is not None)


def _store(storage: Path, tracking_uri: str | None) -> str:
    """Return the URI of the tracker to write to."""
    from orchestrator.tracking.uri import tracking_uri as store_uri

    return store_uri(storage, tracking_uri)


def _pretrained(
    names: list[str] | None, space: SearchSpace, storage: Path, tracking_uri: str | None
) -> tuple[list[Pretrained], Runs]:
    """Return the sources of --source, and which of them each seed uses."""
    from orchestrator.model_registry import pretrained

    found = pretrained.read(names, space, _store(storage, tracking_uri)) if names else []
    return found, pretrained.runs(found, (*space.every_seed, *space.confirm_seeds))


def _forecast(space: SearchSpace, how: Settings, folder: Path, as_json: bool) -> None:
    """Print what the sweep would do and cost."""
    from deltatune.cli.dry_run import print_forecast

    print_forecast(space, how, folder, as_json)


def _run(opened: AbstractContextManager[SweepSession], how: Settings, as_json: bool) -> None:
    """Run the missing cells of a sweep; publish and print what it found, or that it was interrupted.

    Raises InputError where no cluster answers at the address, before the sweep is opened.
    """
    if how.address:
        from orchestrator.cluster.connection import check_address

        check_address(how.address)
    from dashboards.renderers.drawing_process import DrawingProcess

    with opened as session, DrawingProcess() as artist:
        tally = session.run(how, meanwhile=lambda: _load_report(artist))
        from deltatune.cli.sweep_report import interrupted, report

        if tally.left:
            interrupted(session, tally, as_json)
        report(session, tally, as_json, artist)


def _seeds(text: str | None) -> int | Literal["auto"] | None:
    """Read the value of --seeds. Raises InputError for what is neither a number nor auto."""
    from trainables.errors import InputError, shown

    if text is None or text == "auto":
        return None if text is None else "auto"
    try:
        return int(text)
    except ValueError:
        few = " of fewer digits" if text.strip("+- ").isdecimal() else ""
        raise InputError(f"--seeds must be a whole number{few}, or auto (got {shown(text)})") from None


def _settled(params: Path | None) -> Params:
    """Return the hyperparameters in the file of --params, by arm."""
    if params is None:
        return {}
    from orchestrator.export.best_params import read_params

    return read_params(params)


def _warn(space: SearchSpace, params: Path | None, settled: Params) -> None:
    """Print warnings: entries of --params that do not apply, and AUCs of too few evaluations."""
    from orchestrator.planning.evaluations import few_evaluations_in
    from orchestrator.planning.params import check_params

    for warning in (check_params(str(params), settled, space), few_evaluations_in(space)):
        if warning:
            err.print(warning, style="yellow", soft_wrap=True)


def _load_report(artist: DrawingProcess) -> None:
    """Import what publishing needs, while the driver waits for the cells."""
    from deltatune.publish import load

    load(artist)


def _summary(name: str, space: SearchSpace) -> str:
    """Return a sweep's size in a line: '3 agents on 7 targets, 20 seeds'."""
    targets = {target for scenario in space.scenarios for target in scenario.targets}
    counts = ((len(space.agents), "agent"), (len(targets), "target"), (len(space.seeds), "seed"))
    agents, tasks, seeds = (f"{count} {word}{'' if count == 1 else 's'}" for count, word in counts)
    seeds = f"{space.sequential.group} to {seeds}" if space.sequential else seeds
    return f"{name}: {agents} on {tasks}, {seeds}"


def _check_local(how: Settings) -> None:
    """Raise InputError for options that only mean something with Ray."""
    from orchestrator.cluster.resources import Resources
    from trainables.errors import InputError

    if how.address:
        raise InputError(f"--local runs without Ray: it cannot join a cluster (got --address {how.address})")
    if how.resources != Resources():
        raise InputError("--local reserves nothing: --cpus-per-cell, --gpus-per-cell and --memory-per-cell need Ray")


def _settings(items: list[str]) -> dict[str, Any]:
    """Read KEY=VALUE items as YAML scalars."""
    from search_spaces.safe_yaml import scalar
    from trainables.errors import InputError

    values = {}
    for item in items:
        key, equals, text = item.partition("=")
        if not equals or not key:
            raise InputError(f"--set takes HYPERPARAMETER=VALUE (got '{item}')")
        values[key.strip()] = scalar(text)
    return values
