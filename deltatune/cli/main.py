"""Entry point of `deltatune`. Heavy imports are inside the commands that need them."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence

import typer
from typer.exceptions import TyperException

from deltatune.cli.app import app
from deltatune.cli.commands import (
    catalogue,
    cluster,
    contrast,
    custom_code,
    dataset,
    importance,
    manage,
    play,
    sources,
    sweep,
    sweeps,
)
from deltatune.cli.streams import Streams
from trainables.collector import collect_seldom
from trainables.errors import InputError, from_validation

__all__ = [
    "app",
    "catalogue",
    "cluster",
    "contrast",
    "custom_code",
    "dataset",
    "importance",
    "main",
    "manage",
    "play",
    "sources",
    "sweep",
    "sweeps",
]


def main() -> None:
    """Run the command line. Bad input is one sentence and exit code 2; a failing output stream stops no work."""
    collect_seldom()
    streams = Streams()
    try:
        code = _run()
    finally:
        failure = streams.failure()
    if failure is not None:
        typer.echo(f"error: {failure}", err=True)
    raise SystemExit(code or (0 if failure is None else 1))


def _run() -> int:
    """Run the command and return its exit code."""
    from orchestrator.errors import exit_code, sentence

    try:
        return _code(app(args=anywhere(sys.argv[1:]), standalone_mode=False))
    except SystemExit as end:
        return _code(end.code)
    except typer.Abort:
        typer.echo("aborted", err=True)
        return 1
    except TyperException as error:  # an unknown option, or a value that it does not take
        if message := _usage(error):  # empty: there were no arguments, and the help was printed
            typer.echo(f"error: {sentence(InputError(message))}", err=True)
        return error.exit_code
    except Exception as error:
        code = exit_code(error)
        if code is None:
            raise
        typer.echo(f"error: {sentence(error)}", err=True)
        return code


def anywhere(words: Sequence[str]) -> list[str]:
    """Return a command line with -q and -v in front, where they work; people write them at its end too."""
    end = words.index("--") if "--" in words else len(words)
    common = [word for word in words[:end] if re.fullmatch("-q|-v+|--quiet|--verbose", word)]
    return [*common, *(word for word in words[:end] if word not in common), *words[end:]]


def _usage(error: TyperException) -> str:
    """Return what is wrong with a command line: the option or argument, what is allowed, and what was given."""
    from pydantic import ValidationError

    parameter = getattr(error, "param", None)
    if not isinstance(error.__cause__, ValidationError) or parameter is None:
        return error.format_message().strip()
    option = any(name.startswith("-") for name in parameter.opts)
    return str(from_validation(max(parameter.opts, key=len) if option else parameter.metavar, error.__cause__))


def _code(value: object) -> int:
    """Return the exit code that a command's return value, or that of `sys.exit`, stands for."""
    return value if isinstance(value, int) else int(value is not None)


if __name__ == "__main__":
    main()
