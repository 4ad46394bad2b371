"""The command that runs a sweep."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltatune.cli.app import RESULTS, RUN_PANEL, Json, Storage, TrackingUri, app, err, out

if TYPE_CHECKING:
    from orchestrator.execution.settings import Settings


@app.command(rich_help_panel=RUN_PANEL)
def sweep(
    space: Annotated[
        str, typer.Argument(metavar="SPACE", help="A built-in search space (see 'deltatune spaces') or a YAML file.")
    ],
    name: Annotated[str | None, typer.Option(help="The sweep's name; default: the search space's.")] = None,
    storage: Storage = RESULTS,
    task: Annotated[list[str] | None, typer.Option("--tasks", help="Only these target tasks; repeat for more.")] = None,
    agent: Annotated[list[str] | None, typer.Option("--agents", help="Only these agents; repeat for more.")] = None,
    seeds: Annotated[int | None, typer.Option(help="Number of seeds; default: the search space's.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="HYPERPARAMETER=VALUE for every agent that has it.")
    ] = None,
    params: Annotated[Path | None, typer.Option(help="Best hyperparameters from 'deltatune export'.")] = None,
    source: Annotated[
        list[str] | None,
        typer.Option(help="Use this source, train none: models:/NAME@best, models:/NAME/3 or a file; repeat for more."),
    ] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Cells at a time; default: one per CPU.")] = None,
    address: Annotated[str | None, typer.Option(help="Join this Ray cluster: HOST:PORT or 'auto'.")] = None,
    local: Annotated[
        bool, typer.Option("--local", help="Without Ray: in this process, or in --workers processes beside it.")
    ] = False,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Run failed cells again.")] = False,
    checkpoint_every: Annotated[float, typer.Option(min=0, help="Seconds between checkpoints of a long cell.")] = 5.0,
    time_limit: Annotated[float | None, typer.Option(min=0.1, help="Seconds that a cell may take.")] = None,
    cpus_per_cell: Annotated[float, typer.Option(min=0.01, help="CPUs of a cell; a fraction shares one.")] = 1.0,
    gpus_per_cell: Annotated[float, typer.Option(min=0, help="GPUs of a cell; a fraction shares one.")] = 0.0,
    memory_per_cell: Annotated[float, typer.Option(min=0, help="GiB of memory to reserve for a cell.")] = 0.0,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what it would do and cost.")] = False,
    mlflow: Annotated[bool, typer.Option(help="Record in MLflow.")] = True,
    tracking_uri: TrackingUri = None,
    as_json: Json = False,
) -> None:
    """Run a search space: train the sources, then every agent on every target, and compare.

    The same command again continues what was interrupted and runs what a grown search space adds; cells that are
    done are never run twice. Try `deltatune sweep demo`, or a small
    `deltatune sweep demo --seeds 2 --set episodes=500 --name try`.
    """
    from orchestrator.process_env import prepare

    prepare(joins_cluster=address is not None)
    from deltatune.cli.sweep_report import interrupted, report
    from orchestrator.cluster.resources import Resources
    from orchestrator.execution.session import SweepSession
    from orchestrator.execution.settings import Settings
    from orchestrator.export.best_params import read_params
    from orchestrator.model_registry import pretrained
    from orchestrator.planning.params import check_params
    from orchestrator.results.sweep_folder import Results
    from orchestrator.tracking.uri import tracking_uri as store_uri
    from search_spaces import narrow
    from search_spaces.loading import load

    chosen = narrow(
        load(space), tasks=task or (), agents=agent or (), seeds=seeds, hyperparameters=_settings(settings or [])
    )
    settled = read_params(params) if params else {}
    if said := check_params(str(params), settled, chosen):
        err.print(said, style="yellow", soft_wrap=True)
    sources = pretrained.read(source, chosen, store_uri(storage, tracking_uri)) if source else []
    how = Settings(
        workers=workers,
        address=address,
        local=local,
        retry_failed=retry_failed,
        checkpoint_seconds=checkpoint_every,
        time_limit=time_limit,
        resources=Resources(cpus_per_cell, gpus_per_cell, memory_per_cell),
        params=settled,
        pretrained=pretrained.runs(sources, chosen.seeds),
    )
    if local:
        _check_local(how)
    uri = store_uri(storage, tracking_uri) if mlflow else None
    if dry_run:
        from deltatune.cli.dry_run import say_forecast

        say_forecast(chosen, how, Results(storage / (name or chosen.name)), as_json)
        return
    if address:
        from orchestrator.cluster.connection import check_address

        check_address(address)
    with SweepSession.open(
        storage, name or chosen.name, chosen, sources=sources, tracking_uri=uri, console=err if as_json else out
    ) as session:
        tally = session.run(how)
        if tally.left:
            interrupted(session, tally, as_json)
        report(session, tally, as_json)


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
    from search_spaces.loading import scalar
    from trainables.errors import InputError

    values = {}
    for item in items:
        key, equals, text = item.partition("=")
        if not equals or not key:
            raise InputError(f"--set takes HYPERPARAMETER=VALUE (got '{item}')")
        values[key.strip()] = scalar(text)
    return values
