"""The command that runs a sweep."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from orchestrator.commands.app import RESULTS, Json, Storage, TrackingUri, app, err, out


@app.command()
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
    workers: Annotated[int | None, typer.Option(min=1, help="Cells at a time; default: one per CPU.")] = None,
    address: Annotated[str | None, typer.Option(help="Join this Ray cluster: HOST:PORT or 'auto'.")] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Run failed cells again.")] = False,
    checkpoint_every: Annotated[float, typer.Option(min=0, help="Seconds between checkpoints of a long cell.")] = 5.0,
    mlflow: Annotated[bool, typer.Option(help="Record in MLflow.")] = True,
    tracking_uri: TrackingUri = None,
    as_json: Json = False,
) -> None:
    """Run a search space: train the sources, then every agent on every target, and compare.

    The same command again continues what was interrupted and runs what a grown search space adds; cells that are
    done are never run twice. Try `deltatune sweep demo`, or a small
    `deltatune sweep demo --seeds 2 --set episodes=500 --name try`.
    """
    from orchestrator.environment import prepare

    prepare(joins_cluster=address is not None)
    from orchestrator import tracking
    from orchestrator.commands.report import report
    from orchestrator.export import read_params
    from orchestrator.results import Results
    from orchestrator.store import tracking_uri as store_uri
    from orchestrator.sweep import Settings, run
    from search_spaces import load, narrow

    chosen = narrow(
        load(space), tasks=task or (), agents=agent or (), seeds=seeds, hyperparameters=_settings(settings or [])
    )
    settled = read_params(params) if params else {}
    uri = store_uri(storage, tracking_uri)
    if address:
        from orchestrator.runner import check_address

        check_address(address)
    results = Results.create(storage, name or chosen.name, chosen)
    tracker = tracking.Tracker(results, uri) if mlflow else None
    tally = run(
        results,
        Settings(workers, address, retry_failed, checkpoint_every, settled),
        err if as_json else out,
        tracker.record if tracker else lambda stage, record: None,
    )
    report(results, tally, tracker, as_json)


def _settings(items: list[str]) -> dict[str, Any]:
    """Read KEY=VALUE items as YAML scalars."""
    from search_spaces import scalar
    from trainables.errors import InputError

    values = {}
    for item in items:
        key, equals, text = item.partition("=")
        if not equals or not key:
            raise InputError(f"--set takes HYPERPARAMETER=VALUE (got '{item}')")
        values[key.strip()] = scalar(text)
    return values
