#!/usr/bin/env -S pipx run
# /// script
# dependencies = ["nox"]
# ///
"""The commands of the Makefile on every Python that is there: `nox` (https://nox.thea.codes)."""

from __future__ import annotations

import nox

nox.needs_version = ">=2025.10.14"
nox.options.default_venv_backend = "venv"


@nox.session(python=["3.11", "3.12", "3.13"], default=True)
def tests(session: nox.Session) -> None:
    """Run the tests; arguments after `--` go to pytest."""
    session.install("--constraint", "constraints.txt", "--editable", ".[dev]")
    session.run("python", "-m", "pytest", *session.posargs)


@nox.session(python=False, default=False)
def lint(session: nox.Session) -> None:
    """Run ruff, mypy and import-linter."""
    session.run("make", "lint", external=True)


if __name__ == "__main__":
    nox.main()
