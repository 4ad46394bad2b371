"""The parts of the site that are not in docs/: pages from other folders, the reference, and the notebooks as pages.

Documents have links for a code host; those that leave docs/ are turned into links of the site here.
"""

from __future__ import annotations

import json
import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).parent.parent.parent

MOVED = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "deploy/README.md": "deploy.md",
}
"""Documents outside docs/, and the pages that they become."""

LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the generated pages."""
    pages = {page: (ROOT / name).read_text() for name, page in MOVED.items()}
    pages |= {"reference/commands.md": commands(), "reference/python.md": interface()}
    for path in sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")):
        pages[f"notebooks/{path.stem}.md"] = notebook(path)
    for name, text in pages.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Files) -> str:
    """Turn the links of a page into links of the site; one to a file that the site lacks becomes plain text."""
    uri = page.file.src_uri
    origin = next((name for name, there in MOVED.items() if there == uri), f"docs/{uri}")
    pieces = re.split(r"(^```.*?^```[^\n]*$)", markdown, flags=re.MULTILINE | re.DOTALL)
    return "".join(
        piece if piece.startswith("```") else LINK.sub(lambda found: _link(found, origin, uri, files), piece)
        for piece in pieces
    )


def _link(found: re.Match[str], origin: str, uri: str, files: Files) -> str:
    mark, text, target = found.groups()
    path, _, anchor = target.partition("#")
    if "://" in target or target.startswith("mailto:") or not path:
        return found.group(0)
    there = posixpath.normpath(posixpath.join(posixpath.dirname(origin), path))
    place = MOVED.get(there) or MOVED.get(f"{there}/README.md") or there.removeprefix("docs/")
    if place.endswith(".ipynb"):
        place = place.removesuffix(".ipynb") + ".md"
    if files.get_file_from_path(place) is None:
        return text
    relative = posixpath.relpath(place, posixpath.dirname(uri) or ".")
    return f"{mark}[{text}]({relative}{'#' + anchor if anchor else ''})"


def notebook(path: Path) -> str:
    """Return a notebook as Markdown: its texts, and its code with what it printed."""
    parts = []
    for cell in json.loads(path.read_text())["cells"]:
        source = "".join(cell["source"])
        parts.append(f"```python\n{source}\n```" if cell["cell_type"] == "code" else source)
    return "\n\n".join([*parts, f"[This page as a notebook]({path.name})"])


def interface() -> str:
    """Return the reference of the Python interface: every name of `deltatune`, from its docstring."""
    import deltatune

    parts = ["# Python", "Everything here is imported from `deltatune`, and loaded when it is first used."]
    parts += [f"::: {module}.{name}" for _, (module, name) in sorted(deltatune._HOME.items(), key=_order)]
    return "\n\n".join(parts)


def _order(item: tuple[str, tuple[str, str]]) -> tuple[bool, str]:
    name, (module, _) = item
    return not module.startswith("deltatune"), name.lower()


def commands() -> str:
    """Return the reference of the command line, from the application itself."""
    import typer.main

    from deltatune.cli.main import app

    group: Any = typer.main.get_command(app)
    context = group.context_class(group, info_name="deltatune")
    parts = ["# Commands", _options(group)]
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        parts += _command(f"deltatune {name}", command, "##")
        for sub in getattr(command, "commands", {}):
            parts += _command(f"deltatune {name} {sub}", command.commands[sub], "###")
    return "\n\n".join(part for part in parts if part)


def _command(name: str, command: Any, level: str) -> list[str]:
    arguments = [_metavar(each) for each in command.params if each.param_type_name == "argument"]
    usage = " ".join([name, *arguments, "[OPTIONS]"])
    return [f"{level} {name}", f"```text\n{usage}\n```", _plain(command.help or ""), _options(command)]


def _options(command: Any) -> str:
    rows = [
        f"| {_names(each)} | {_plain(getattr(each, 'help', None) or '').replace('|', chr(92) + '|')} |"
        for each in command.params
        if not getattr(each, "hidden", False)
    ]
    return "\n".join(["| argument or option | |", "|---|---|", *rows]) if rows else ""


def _names(parameter: Any) -> str:
    if parameter.param_type_name == "argument":
        return f"`{_metavar(parameter)}`".replace("|", "\\|")
    value = (
        "" if getattr(parameter, "is_flag", False) or getattr(parameter, "count", False) else f" {_metavar(parameter)}"
    )
    names = [*parameter.opts, *parameter.secondary_opts]
    return ", ".join(f"`{name}{value}`" for name in names).replace("|", "\\|")


def _metavar(parameter: Any) -> str:
    choices = getattr(parameter.type_descriptor, "choices", None)
    if choices and not parameter.metavar:
        return "|".join(str(getattr(each, "value", each)) for each in choices)
    return str(parameter.metavar or (parameter.name or "").upper())


def _plain(text: str) -> str:
    return text.replace("<", "&lt;").replace("\b", "").strip()
