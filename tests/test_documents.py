"""The documents point at files that are there, at commands and options that exist, and at messages that are said."""

from __future__ import annotations

import ast
import re
import shlex
from pathlib import Path

import pytest
import typer.main

from deltatune.cli.main import app
from search_spaces.loading import built_in

ROOT = Path(__file__).parent.parent
DOCUMENTS = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    ROOT / "deploy/README.md",
    *sorted((ROOT / "docs").glob("*.md")),
]
KNOWN = typer.main.get_command(app).commands  # type: ignore[attr-defined]
TEXTS = {document: document.read_text() for document in DOCUMENTS}
COMMANDS = {
    line.partition("#")[0].strip().removeprefix(".venv/bin/")
    for text in TEXTS.values()
    for line in re.findall(r"^(?:\.venv/bin/)?deltatune [^\n`]*", text, re.MULTILINE)
}
MENTIONS = {word for text in TEXTS.values() for word in re.findall(r"`(?:\.venv/bin/)?deltatune (\w+)", text)}
MESSAGES = re.findall(r"^\| `(.+?)` \|", (ROOT / "docs/faq.md").read_text(), re.MULTILINE)


def _anchors(text: str) -> set[str]:
    """The anchors of a document's headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_every_link_of_a_document_leads_somewhere(document: Path) -> None:
    links = [link for link in re.findall(r"\]\(([^)]+)\)", TEXTS[document]) if "://" not in link]
    for link in links:
        name, _, anchor = link.partition("#")
        target = document.parent / name if name else document
        assert target.exists(), link
        assert not anchor or anchor in _anchors(target.read_text()), link


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_every_command_of_a_document_is_one(command: str) -> None:
    _, name, *rest = shlex.split(command.partition(">")[0])
    assert name in KNOWN
    known = KNOWN[name]
    if hasattr(known, "commands"):
        assert rest[0] in known.commands
        known, rest = known.commands[rest[0]], rest[1:]
    options = {option for parameter in known.params for option in parameter.opts}
    assert {word for word in rest if word.startswith("-")} <= options
    if name in ("sweep", "submit", "spaces") and rest:
        own = name == "sweep" and rest[0] == "--name"  # the search space of that sweep
        assert own or rest[0] in {*built_in(), "SPACE"} or rest[0].endswith(".yaml")


@pytest.mark.parametrize("name", sorted(MENTIONS))
def test_every_command_that_is_spoken_of_is_one(name: str) -> None:
    assert name in KNOWN


def test_the_readme_leads_to_every_document() -> None:
    assert not [path.name for path in (ROOT / "docs").glob("*.md") if f"docs/{path.name}" not in TEXTS[DOCUMENTS[0]]]


@pytest.fixture(scope="module")
def said() -> str:
    """Every piece of text in the packages' code, a line each."""
    files = [
        path
        for package in ("trainables", "search_spaces", "orchestrator", "deltatune")
        for path in (ROOT / package).rglob("*.py")
    ]
    trees = [ast.parse(path.read_text()) for path in files]
    texts = [node.value for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    return "\n".join(text for text in texts if isinstance(text, str))


@pytest.mark.parametrize("message", MESSAGES)
def test_every_message_of_the_faq_is_said_by_the_code(message: str, said: str) -> None:
    assert not [part for part in message.split("…") if part not in said]


def test_there_is_something_to_check() -> None:
    assert len(COMMANDS) > 5
    assert len(MENTIONS) > 5
    assert len(MESSAGES) > 40


@pytest.mark.parametrize("example", sorted((ROOT / "docs" / "examples").glob("*.py")), ids=lambda path: path.name)
def test_an_example_is_in_its_page_word_for_word(example: Path) -> None:
    pages = [page.read_text() for page in (ROOT / "docs").glob("custom_*.md")]
    code = [block.strip() for page in pages for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL)]
    assert example.read_text().partition('"""\n\n')[2].strip() in code
