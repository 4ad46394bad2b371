"""Commands on the source library, and the ranking of its sources."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from deltatune.cli.app import CATALOGUE_PANEL, RESULTS, Files, Json, Storage, app, busy, load_files, out, print_json
from trainables.plugins.names import short

sources = typer.Typer(no_args_is_help=True, help="The source library: list, check, export and import trained sources.")
app.add_typer(sources, name="sources", rich_help_panel=CATALOGUE_PANEL)

MAX_EPISODES, MAX_SEED = 1_000_000, 2**63 - 1
"""Of a ranking."""

MAX_ROWS = 20
"""In the table of a ranking."""

Names = Annotated[
    list[str] | None, typer.Argument(metavar="[SOURCE]...", help="Only these sources, by id or task; default: all.")
]


@sources.command("list")
def list_(names: Names = None, storage: Storage = RESULTS, as_json: Json = False) -> None:
    """List the trained sources: task, agent, seed, returns, version, size. Every checksum is verified on the way."""
    from deltatune.cli.sheet import table
    from orchestrator.sources.library import SourceLibrary, row

    data = [row(entry) for entry in SourceLibrary(storage).find(names or [])]
    if as_json:
        print_json(data)
        return
    if not data:
        out.print(f"{storage} holds no source yet; a sweep keeps those that it trains", soft_wrap=True)
        return
    columns = ("id", "task", "agent", "seed", "episodes", "best return", "last return", "deltatune", "kB")
    out.print(table(columns, [_line(each) for each in data]))


def _line(data: dict[str, Any]) -> tuple[str, ...]:
    returns = ["-" if data[key] is None else f"{data[key]:.2f}" for key in ("best_return", "final_return")]
    text = [str(data[key]) for key in ("id", "task", "agent", "seed", "episodes")]
    return (*text, *returns, data["versions"].get("deltatune", "-"), f"{data['bytes'] / 1024:.0f}")


@sources.command()
def add(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A library file (.npz).")],
    storage: Storage = RESULTS,
    as_json: Json = False,
) -> None:
    """Add one library file, from another storage folder for instance."""
    from orchestrator.sources.archive import MAX_BYTES
    from orchestrator.sources.library import SourceLibrary
    from trainables.storage.files import read_file

    entry = SourceLibrary(storage).add(read_file(file, MAX_BYTES), str(file))
    if as_json:
        print_json({"added": entry.id, "cell": entry.cell.to_json()})
        return
    out.print(f"added {entry.id}: {entry.cell.agent} on {entry.cell.task}, seed {entry.cell.seed}", soft_wrap=True)


@sources.command()
def remove(
    names: Annotated[list[str], typer.Argument(metavar="ID...", help="The full ids of the sources.")],
    storage: Storage = RESULTS,
    as_json: Json = False,
) -> None:
    """Remove sources. A sweep that needs one trains it again."""
    from orchestrator.sources.library import SourceLibrary

    for name in names:
        SourceLibrary(storage).remove(name)
    if as_json:
        print_json({"removed": names})
    else:
        out.print(f"removed {len(names)}")


@sources.command()
def verify(storage: Storage = RESULTS, as_json: Json = False) -> None:
    """Check every file: its checksum, its shapes, and that its name is the id of its cell (exit 1 if not)."""
    from orchestrator.sources.library import SourceLibrary
    from trainables.errors import InputError

    library = SourceLibrary(storage)
    broken: dict[str, str] = {}
    for cell_id in library.ids():
        try:
            library.entry(cell_id)
        except InputError as error:
            broken[cell_id] = str(error)
    if as_json:
        print_json({"sources": len(library.ids()), "broken": broken})
    else:
        for sentence in broken.values():
            out.print(sentence, soft_wrap=True)
        out.print(f"{len(library.ids()) - len(broken)} of {len(library.ids())} sources are intact")
    if broken:
        raise typer.Exit(1)


@sources.command()
def export(
    names: Names = None,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FILE", help="The file to write.")] = Path(
        "sources.zip"
    ),
    storage: Storage = RESULTS,
    as_json: Json = False,
) -> None:
    """Write sources into one file with checksums."""
    from orchestrator.sources.archive import export_sources
    from orchestrator.sources.library import SourceLibrary

    library = SourceLibrary(storage)
    count = export_sources(library, library.find(names or []), output)
    if as_json:
        print_json({"file": str(output), "sources": count})
    else:
        out.print(f"{count} sources: {output}", soft_wrap=True)


@sources.command("import")
def import_(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What 'deltatune sources export' wrote.")],
    names: Names = None,
    storage: Storage = RESULTS,
    as_json: Json = False,
) -> None:
    """Import sources from an exported file: all of them, or none if one is damaged."""
    from orchestrator.sources.archive import import_sources
    from orchestrator.sources.library import SourceLibrary

    entries = import_sources(SourceLibrary(storage), file, names or [])
    if as_json:
        print_json({"imported": [entry.id for entry in entries]})
    else:
        out.print(f"{len(entries)} sources from {file}", soft_wrap=True)


@app.command(rich_help_panel=CATALOGUE_PANEL)
def rank(
    target: Annotated[
        str, typer.Argument(metavar="TARGET", help="The target task, such as windy_gridworld:wind=reversed.")
    ],
    source: Annotated[
        list[str] | None,
        typer.Option("--sources", metavar="SOURCE", help="An id or a task; repeat for more. Default: the library."),
    ] = None,
    episodes: Annotated[
        int,
        typer.Option(
            min=2, max=MAX_EPISODES, metavar="N", help="Episodes to play on the target, for all sources together."
        ),
    ] = 100,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, metavar="SEED", help="The seed of the episodes.")] = 0,
    file: Files = None,
    storage: Storage = RESULTS,
    as_json: Json = False,
) -> None:
    """Rank trained sources for a target task by delta along the path of each, and recommend one or none.

    The delta of every source is estimated from the same target episodes. Exit code 3: none is recommended.
    """
    with busy("acting on the target"):
        from orchestrator.sources.library import SourceLibrary
        from orchestrator.sources.ranking import rank_sources
        from trainables.plugins.loader import canonicalise

        load_files(file)
        target, names = canonicalise(target), [canonicalise(name) for name in source or ()]
        found = rank_sources(target, SourceLibrary(storage).find(names), episodes, seed)
    data = found.to_json()
    if as_json:
        print_json(data)
    else:
        _print_ranking(data)
    if data["recommended"] is None:
        raise typer.Exit(3)


def _print_ranking(data: dict[str, Any]) -> None:
    from deltatune.cli.sheet import table

    columns: tuple[str, ...] = ("id", "source task", "seed", "discounted return [95%]", "advantage kept [at least]")
    columns += ("|delta|", "|delta| at home", "episodes", "verdict")
    every = data["sources"]
    title = f"Sources for {short(data['target'])}, by the lower end of the return's interval"
    out.print(table(columns, [_ranked(each) for each in every[:MAX_ROWS]], title))
    if len(every) > MAX_ROWS:
        out.print(f"... and {len(every) - MAX_ROWS} more (--json has all)")
    out.print(f"{data['steps']} steps on the target; acting at random returns {data['random_return']:.1f}.")
    out.print(
        "Advantage: the return that a source predicts for itself, over that of acting at random. Kept: the share of "
        "it that remains on the target.",
        soft_wrap=True,
    )
    if data["recommended"] is None:
        kept = "unknown" if every[0]["kept"] is None else f"{every[0]['kept']:.0%}"
        out.print("None is similar enough: learn without a source.", soft_wrap=True)
        out.print(
            f"The best, {every[0]['id']}, keeps {kept} of its predicted advantage over acting at random.",
            soft_wrap=True,
        )
    else:
        out.print(f"Recommended: {every[0]['id']}, trained on {every[0]['task']}.", soft_wrap=True)


def _ranked(data: dict[str, Any]) -> tuple[str, ...]:
    tried = data["value"] is not None
    value = f"{data['value']:.1f} [{data['low']:.1f}, {data['high']:.1f}]" if tried else "not tried"
    kept = f"{data['kept']:.0%} [{data['kept_low']:.0%}]" if tried else "-"
    sizes = f"{data['delta']:.2f}", f"{data['self_delta']:.2f}"
    return (
        data["id"],
        short(data["task"]),
        str(data["seed"]),
        value,
        kept,
        *sizes,
        str(data["episodes"]),
        data["verdict"],
    )
