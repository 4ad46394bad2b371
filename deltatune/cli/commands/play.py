"""The command that films a trained agent."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltatune.cli.app import (
    RESULT_PANEL,
    RESULTS,
    Files,
    Json,
    Storage,
    TrackingUri,
    app,
    busy,
    err,
    load_files,
    out,
    print_json,
)

if TYPE_CHECKING:
    from dashboards.play.episode import Episode
    from trainables.cell import Cell


What = Annotated[
    str, typer.Argument(metavar="WHAT", help="A cell's id, models:/NAME@ALIAS, or a file of a source library (.npz).")
]
Output = Annotated[
    Path, typer.Option("-o", "--output", metavar="FILE", help="The .gif to write; an .mp4; a .png of the end.")
]
OnTask = Annotated[
    str | None, typer.Option("--task", metavar="TASK", help="Act on this task; default: the one it was trained on.")
]
Seed = Annotated[int, typer.Option(min=0, metavar="SEED", help="The seed of the episode.")]
InSweep = Annotated[str | None, typer.Option("--sweep", metavar="SWEEP", help="Look in this sweep alone.")]


@app.command(rich_help_panel=RESULT_PANEL)
def play(
    what: What,
    output: Output = Path("play.gif"),
    task: OnTask = None,
    seed: Seed = 0,
    name: InSweep = None,
    file: Files = None,
    storage: Storage = RESULTS,
    tracking_uri: TrackingUri = None,
    as_json: Json = False,
) -> None:
    """Film one episode of a greedy policy, next to its source's greedy policy on the same task.

    The windy gridworld is drawn with its wind, the path, and |delta| over its states; other tasks with their own
    rendering. An agent of the transfer stage is first trained again, which gives the same bits.
    """
    with busy("filming"):
        from dashboards.play.film import check_suffix, write
        from dashboards.play.play import play as play_episodes
        from orchestrator.execution.actors import cast
        from orchestrator.process_env import prepare
        from orchestrator.tracking.uri import tracking_uri as store_uri
        from trainables.plugins.loader import canonicalise

        check_suffix(output)
        prepare()
        load_files(file)
        store, on = functools.partial(store_uri, storage, tracking_uri), canonicalise(task) if task else None
        found = cast(what, storage, store, task=on, sweep=name, on_training=_say_training)
        episodes, images = play_episodes(found.task, found.actors, seed)
        write(images, output)
    if as_json:
        print_json({"file": str(output), "task": found.task.name, "episodes": [_data(each) for each in episodes]})
        return
    for each in episodes:
        out.print(f"{each.title}: return {each.returns[-1]:.4g} in {each.steps} steps", soft_wrap=True)
    out.print(f"Film:     {output}", soft_wrap=True)


def _say_training(cell: Cell) -> None:
    err.print(f"training {cell.agent} on {cell.task} again: {cell.episodes} episodes", soft_wrap=True)


def _data(episode: Episode) -> dict[str, Any]:
    return {
        "title": episode.title,
        "return": episode.returns[-1],
        "steps": episode.steps,
        "terminated": episode.terminated,
    }
