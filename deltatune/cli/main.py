"""Entry point of `deltatune`. Heavy imports are inside the commands that need them."""

from __future__ import annotations

import typer

from deltatune.cli.app import app
from deltatune.cli.commands import catalogue, cluster, custom_code, manage, play, sources, sweep, sweeps
from deltatune.cli.streams import Streams

__all__ = ["app", "catalogue", "cluster", "custom_code", "main", "manage", "play", "sources", "sweep", "sweeps"]


def main() -> None:
    """Entry point: bad input is one sentence and exit code 2, never a traceback; output that fails stops no work."""
    streams = Streams()
    try:
        code = _run()
    finally:
        failure = streams.failure()
    if failure is not None:
        typer.echo(f"error: {failure}", err=True)
    raise SystemExit(code or (0 if failure is None else 1))


def _run() -> int:
    """Run the command; its exit code."""
    from orchestrator.errors import exit_code, sentence

    try:
        app()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except Exception as error:
        code = exit_code(error)
        if code is None:
            raise
        typer.echo(f"error: {sentence(error)}", err=True)
        return code
    return 0


if __name__ == "__main__":
    main()
