"""The command that films a trained agent."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deltatune.cli.app import RESULT_PANEL, RESULTS, Json, Storage, TrackingUri, app, busy, err, out, print_json

if TYPE_CHECKING:
    from dashboards.play.episode import Episode


@app.command(rich_help_panel=RESULT_PANEL)
def play(
    what: Annotated[
        str,
        typer.Argument(metavar="WHAT", help="A cell's id, models:/NAME@ALIAS, or a file of a source library (.npz)."),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="FILE", help="The .gif to write; an .mp4; a .png of the end.")
    ] = Path("play.gif"),
    task: Annotated[
        str | None, typer.Option("--task", metavar="TASK", help="Act on this task; default: the one it was trained on.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, metavar="SEED", help="The seed of the episode.")] = 0,
    name: Annotated[str | None, typer.Option("--sweep", metavar="SWEEP", help="Look in this sweep alone.")] = None,
    file: Annotated[
        list[str] | None, typer.Option("--file", metavar="FILE.py", help="Run this file first; repeat for more.")
    ] = None,
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
        from trainables.plugins.loader import canonicalise, load_file

        check_suffix(output)
        prepare()
        for path in file or ():
            load_file(path)
        found = cast(
            what,
            storage,
            lambda: store_uri(storage, tracking_uri),
            task=canonicalise(task) if task else None,
            sweep=name,
            on_training=lambda cell: err.print(
                f"training {cell.agent} on {cell.task} again: {cell.episodes} episodes",
                soft_wrap=True,
            ),
        )
        episodes, images = play_episodes(found.task, found.actors, seed)
        write(images, output)
    if as_json:
        print_json({"file": str(output), "task": found.task.name, "episodes": [_data(each) for each in episodes]})
        return
    for each in episodes:
        out.print(f"{each.title}: return {each.returns[-1]:.4g} in {each.steps} steps", soft_wrap=True)
    out.print(f"Film:     {output}", soft_wrap=True)


def _data(episode: Episode) -> dict[str, Any]:
    return {
        "title": episode.title,
        "return": episode.returns[-1],
        "steps": episode.steps,
        "terminated": episode.terminated,
    }
