"""Custom tasks and agents in a search space: loads their files, and adds a hash of the content to their names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from trainables.plugins.loader import canonicalise
from trainables.plugins.names import by_file
from trainables.tasks.registry import parse_task


def pinned(data: dict[str, Any], folders: Sequence[Path]) -> dict[str, Any]:
    """Return the search space `data` with the canonical form of every name of custom code by file.

    folders: where the files are looked for. Data of the wrong shape is left as it is, for `SearchSpace` to refuse.
    """

    def agent(value: Any) -> Any:
        return canonicalise(value, folders) if isinstance(value, str) else value

    def task(value: Any) -> Any:
        return parse_task(agent(value)).name if isinstance(value, str) and by_file(value) else value

    def library(value: Any) -> Any:
        return [task(name) for name in value] if isinstance(value, list) else value

    def scenario(value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        source, targets = value.get("source"), value.get("targets")
        if isinstance(source, dict):
            names = {"task": task, "agent": agent, "library": library}
            source = {key: names[key](v) if key in names else v for key, v in source.items()}
        if isinstance(targets, list):
            targets = [task(target) for target in targets]
        return value | {key: v for key, v in (("source", source), ("targets", targets)) if key in value}

    result = dict(data)
    if isinstance(data.get("scenarios"), list):
        result["scenarios"] = [scenario(value) for value in data["scenarios"]]
    if isinstance(data.get("normalise"), dict):
        result["normalise"] = {task(key): value for key, value in data["normalise"].items()}
    if isinstance(data.get("agents"), dict):
        result["agents"] = {agent(key): value for key, value in data["agents"].items()}
    return result
