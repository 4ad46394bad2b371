"""Notes on custom tasks and agents whose code is not loaded, so that their results can still be read.

They come from the sweep's folder (`remember`), and contain nothing that can be run.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trainables.plugins.loader import BROKEN, others
from trainables.plugins.names import by_file

_NOTES: dict[str, Mapping[str, Any]] = {}
"""Notes by canonical name."""


def remember(notes: Mapping[str, Mapping[str, Any]]) -> None:
    """Store notes by canonical name."""
    _NOTES.update(notes)


def needed_code(kind: str, name: str) -> str:
    """Return, as a sentence, what the code of the missing custom task or agent `name` has to come from."""
    code, _, _ = name.partition(":")
    file, _, pin = code.partition("@")
    if code in BROKEN:
        return f"the {kind} {name} cannot be loaded here ({BROKEN[code]})"
    if by_file(name) and others(file):
        return f"the {kind} {name} is of another {file}: the file is @{others(file)[0]} now, it was @{pin} then"
    if by_file(name):
        return f"the {kind} {name} needs {file} as it was then (@{pin}): name that file, e.g. with --file {file}"
    return f"the {kind} {name} needs the package that registers '{file}' in version {pin}, which is not installed here"
