"""YAML from untrusted files: safe types only, within limits of size and depth."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from trainables.errors import InputError, shown
from trainables.storage.files import read_file

MAX_BYTES = 4 * 2**20
"""Largest file."""

MAX_VALUES = 200_000
"""Most values and keys of a file, with every alias counted as what it stands for."""

MAX_KEYS = 1_000
"""Most keys of one mapping."""

MAX_LEVELS = 32
"""Deepest nesting."""

LARGEST = 2**63 - 1
"""Largest whole number, of either sign."""

_BASE: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Loader(_BASE):  # type: ignore[misc]
    """Safe YAML in which 1e-4 is a number, as YAML 1.2 has it, and a key given twice is an error."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        if len(node.value) > MAX_KEYS:
            raise _refused(f"a mapping has {len(node.value):,} keys, more than {MAX_KEYS:,}", node)
        seen: set[Any] = set()
        for key_node, _ in node.value:
            if isinstance(key_node, yaml.ScalarNode):
                key = self.construct_object(key_node, deep=True)
                if key in seen:
                    raise _refused(f"key '{key}' is given twice", node)
                seen.add(key)
        found: dict[Any, Any] = super().construct_mapping(node, deep)
        return found

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        if len(node.value) <= 100:
            value: int = super().construct_yaml_int(node)
            if abs(value) <= LARGEST:
                return value
        raise _refused(f"a whole number must be at most {LARGEST} (got {shown(node.value)[1:]})", node)


_FLOAT = re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)$")
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+0123456789."))
_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)


def _refused(problem: str, where: Any) -> yaml.constructor.ConstructorError:
    return yaml.constructor.ConstructorError(None, None, problem, where.start_mark)


def load_yaml(text: str) -> Any:
    """Return the value of a YAML text. Raises YAMLError or ValueError for what is no YAML, too large or too deep."""
    _check_size(text)
    return yaml.load(text, Loader=_Loader)  # noqa: S506 (a SafeLoader)


def _check_size(text: str) -> None:
    """Raise YAMLError where `text` is too large or too deep, before any value is built."""
    sizes: dict[str, int] = {}
    opened: list[tuple[str | None, int]] = []  # open anchors, and the number of values before each
    count = 0
    for event in yaml.parse(text, Loader=_BASE):
        if isinstance(event, yaml.AliasEvent):
            if event.anchor in (anchor for anchor, _ in opened):
                raise _refused(f"'*{event.anchor}' contains itself", event)
            count += sizes.get(str(event.anchor), 1)
        elif isinstance(event, yaml.ScalarEvent):
            count += 1
            if event.anchor is not None:
                sizes[event.anchor] = 1
        elif isinstance(event, yaml.CollectionStartEvent):
            opened.append((event.anchor, count))
            count += 1
            if len(opened) > MAX_LEVELS:
                raise _refused(f"it is nested more than {MAX_LEVELS} levels deep", event)
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = opened.pop()
            if anchor is not None:
                sizes[anchor] = count - before
        if count > MAX_VALUES:
            raise _refused(f"it holds more than {MAX_VALUES:,} values, aliases counted as what they stand for", event)


def read_yaml(path: Path) -> Any:
    """Return the contents of a YAML file. Raises InputError, with the line, where it cannot be read."""
    try:
        return load_yaml(read_file(path, MAX_BYTES).decode("utf-8"))
    except UnicodeDecodeError as error:
        raise InputError(f"cannot read {path}: {error}") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" line {mark.line + 1}" if mark else ""
        raise InputError(f"{path}{where}: {getattr(error, 'problem', None) or 'not YAML'}") from None
    except InputError:
        raise
    except (ValueError, RecursionError) as error:  # an impossible date or number, such as 2024-13-45
        raise InputError(f"{path}: {error}") from None


def scalar(text: str) -> Any:
    """Return one value as YAML reads it: 5 and 1e-4 are numbers, terminal is text. Raises InputError for no value."""
    try:
        value = load_yaml(text)
    except (yaml.YAMLError, ValueError, RecursionError):
        value = None
    if not isinstance(value, int | float | str | bool):
        raise InputError(f"'{shown(text)[1:-1]}' is not a value")
    return value
