"""The documents point at files that are there, and at commands and options that exist."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
import typer.main

from orchestrator.cli import app

ROOT = Path(__file__).parent.parent
DOCUMENTS = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
COMMANDS = {
    line.partition("#")[0].strip().removeprefix(".venv/bin/")
    for document in DOCUMENTS
    for line in re.findall(r"^(?:\.venv/bin/)?deltatune [^\n`]*", document.read_text(), re.MULTILINE)
}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_every_link_of_a_document_leads_to_a_file(document: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)[^)]*\)", document.read_text())
    broken = [link for link in links if "://" not in link and not (document.parent / link).exists()]
    assert not broken


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_every_command_of_a_document_is_one(command: str) -> None:
    _, name, *rest = shlex.split(command.partition(">")[0])
    known = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert name in known
    options = {option for parameter in known[name].params for option in parameter.opts}
    assert {word for word in rest if word.startswith("-")} <= options


def test_there_are_commands_to_check() -> None:
    assert len(COMMANDS) > 5
