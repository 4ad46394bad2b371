"""Commands for sweeps that run in another shell or on a cluster."""

from __future__ import annotations

import json
import time
from typing import Annotated

import typer

from deltatune.cli.app import CLUSTER_PANEL, RESULTS, RUN_PANEL, Json, Storage, Sweep, app, out, program


@app.command(context_settings={"allow_extra_args": True, "ignore_unknown_options": True}, rich_help_panel=CLUSTER_PANEL)
def submit(
    context: typer.Context,
    space: Annotated[str, typer.Argument(metavar="SPACE", help="A built-in search space or a YAML file.")],
    address: Annotated[str, typer.Option(metavar="URL", help="The head of a Ray cluster, as http://HOST:8265.")],
    storage: Annotated[
        str,
        typer.Option(
            metavar="FOLDER",
            envvar="DELTATUNE_STORAGE",
            help="A folder that every node can write to, or a URL such as s3://BUCKET/FOLDER.",
        ),
    ],
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="The sweep's name; default: the search space's.")
    ] = None,
) -> None:
    """Submit a sweep to a Ray cluster as a job, which runs on when this shell ends. Takes the options of 'sweep' too.

    Follow it with 'deltatune watch SWEEP --storage ...' and 'deltatune logs SWEEP --storage ...' from any machine that
    reads the storage. Credentials of MLflow and of the storage must be in the environment of the cluster.
    """
    from orchestrator.process_env import prepare

    prepare(joins_cluster=True)
    from deltatune.cli.space_argument import named_space
    from orchestrator.cluster import jobs
    from orchestrator.results.sweep_folder import check_name
    from trainables.storage.folders import absolute
    from trainables.storage.paths import storage_path

    storage = str(absolute(storage_path(storage)))
    words = [*context.args, "--storage", storage]
    wanted = named_space(space)
    name = check_name(wanted.name if name is None else name)
    check_options(["space.yaml", *words, "--name", name])
    head = jobs.client(address)
    jobs.check_storage(head, storage)
    job = jobs.submit(head, wanted, [*words, "--name", name], name)
    out.print(f"Job {job} runs the sweep {name}. Its progress and its log:", soft_wrap=True)
    for command in ("watch", "logs"):
        out.print(f"  {program()} {command} {name} --storage {storage}", soft_wrap=True)
    out.print(f"To stop it: ray job stop --address {address} {job}", soft_wrap=True)


def check_options(words: list[str]) -> None:
    """Raise a usage error, or InputError, for arguments that `sweep` would refuse."""
    from typer.main import get_command

    commands = get_command(app).commands  # type: ignore[attr-defined]
    commands["sweep"].make_context("sweep", words)


@app.command(rich_help_panel=RUN_PANEL)
def watch(
    name: Sweep,
    storage: Storage = RESULTS,
    every: Annotated[
        float,
        typer.Option(min=0.1, max=86_400, metavar="SECONDS", help="Time between two updates."),
    ] = 2.0,
    as_json: Json = False,
) -> None:
    """Follow a sweep that runs in another shell or on a cluster, until it ends.

    With --json each update is a line of JSON, and the last line is that of 'status'.
    """
    from deltatune.cli.watch import follow
    from orchestrator.results.sweep_folder import Results

    follow(Results.open(storage, name), out, every, as_json)


@app.command(rich_help_panel=RUN_PANEL)
def logs(
    name: Sweep,
    storage: Storage = RESULTS,
    follow: Annotated[bool, typer.Option("-f", "--follow", help="Keep printing new lines; Ctrl-C ends it.")] = False,
    as_json: Json = False,
) -> None:
    """Print a sweep's driver log: when it ran, what failed, which workers were lost.

    With --json each line of the log is a line of JSON.
    """
    from orchestrator.results import driver_log
    from orchestrator.results.lock import driver
    from orchestrator.results.sweep_folder import Results

    folder = Results.open(storage, name).folder
    shown = 0
    while True:
        text = driver_log.read(folder)
        new = text[shown:]
        typer.echo(
            "".join(f"{json.dumps({'line': line})}\n" for line in new.splitlines()) if as_json else new, nl=False
        )
        shown = len(text)
        if not follow or driver(folder) is None:
            return
        time.sleep(2.0)
