"""Reading search spaces: the built-in ones by name, and YAML files."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from search_spaces.plugin_names import pinned
from search_spaces.search_space import SearchSpace
from trainables.errors import InputError, from_validation, unknown

FOLDER = Path(__file__).parent / "builtin"


class _Loader(yaml.SafeLoader):
    """Safe YAML in which 1e-4 is a number, as YAML 1.2 has it, and a key given twice is an error."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for key in keys:
            if keys.count(key) > 1:
                raise yaml.constructor.ConstructorError(None, None, f"key '{key}' is given twice", node.start_mark)
        return super().construct_mapping(node, deep)


_FLOAT = re.compile(r"^[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)$")
_Loader.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list("-+0123456789."))


def read_yaml(path: Path) -> Any:
    """Return the contents of a YAML file; InputError where it cannot be read, with the line."""
    try:
        return yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)  # noqa: S506 (a SafeLoader)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" line {mark.line + 1}" if mark else ""
        raise InputError(f"{path}{where}: {getattr(error, 'problem', None) or 'not YAML'}") from None
    except ValueError as error:  # a date or number that is none, such as 2024-13-45
        raise InputError(f"{path}: {error}") from None


def scalar(text: str) -> Any:
    """Return one value as YAML reads it: 5 and 1e-4 are numbers, terminal is text; InputError for what is no value."""
    try:
        value = yaml.load(text, Loader=_Loader)  # noqa: S506 (a SafeLoader)
    except (yaml.YAMLError, ValueError):
        value = None
    if not isinstance(value, int | float | str | bool):
        raise InputError(f"'{text}' is not a value")
    return value


@cache
def built_in() -> dict[str, Path]:
    """Return the files of the built-in search spaces by name."""
    return {path.stem.replace("_", "-"): path for path in sorted(FOLDER.glob("*.yaml"))}


def parse(where: str, data: object, folders: Sequence[Path] = ()) -> SearchSpace:
    """Return the search space in `data`; InputError that starts with `where` for anything wrong in it.

    folders: where the files of custom tasks and agents are looked for, and run. None is run where there are none.
    """
    if not isinstance(data, dict):
        raise InputError(f"{where}: a search space must be a mapping of keys to values")
    if "schema" not in data:
        raise InputError(f"{where}: schema is missing (this version reads schema: 1)")
    try:
        return SearchSpace.model_validate(pinned(data, folders) if folders else data)
    except ValidationError as error:
        raise from_validation(where, error) from None
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def load(name: str) -> SearchSpace:
    """Return the built-in search space called `name`, or the one in the YAML file `name`.

    The files of custom code that a YAML file names are looked for beside it, then in the current folder, and run.
    """
    if name in built_in():
        return parse(name, read_yaml(built_in()[name]))
    path = Path(name)
    if path.suffix in (".yaml", ".yml") or path.is_file():
        return parse(str(path), read_yaml(path), (path.parent, Path()))
    raise unknown("search space (or YAML file)", name, built_in())
