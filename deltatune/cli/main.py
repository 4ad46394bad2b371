"""Entry point of `deltatune`. Heavy imports are inside the commands that need them."""

from __future__ import annotations

import typer

from deltatune.cli import catalogue, cluster, manage, own_code, sources, sweep, sweeps
from deltatune.cli.app import app

__all__ = ["app", "catalogue", "cluster", "main", "manage", "own_code", "sources", "sweep", "sweeps"]


def main() -> None:
    """Entry point: bad input is one sentence and exit code 2, never a traceback."""
    from orchestrator.errors import exit_code

    try:
        app()
    except Exception as error:
        code = exit_code(error)
        if code is None:
            raise
        typer.echo(f"error: {error}", err=True)
        raise SystemExit(code) from None


if __name__ == "__main__":
    main()
