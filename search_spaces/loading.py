"""Reading search spaces: the built-in ones by name, and YAML files."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from search_spaces.plugin_names import pinned
from search_spaces.safe_yaml import read_yaml, scalar
from trainables.errors import InputError, from_validation, unknown

if TYPE_CHECKING:
    from search_spaces.search_space import SearchSpace

__all__ = ["built_in", "load", "parse", "read_yaml", "scalar"]

FOLDER = Path(__file__).parent / "builtin"


@cache
def built_in() -> dict[str, Path]:
    """Return the files of the built-in search spaces by name."""
    return {path.stem.replace("_", "-"): path for path in sorted(FOLDER.glob("*.yaml"))}


def parse(where: str, data: object, folders: Sequence[Path] = ()) -> SearchSpace:
    """Return the search space in `data`. Raises InputError, which starts with `where`, for anything wrong in it.

    folders: where the files of custom tasks and agents are looked for and run; without any, no file is run.
    """
    from search_spaces.search_space import SearchSpace  # with all agents and tasks: listing the spaces needs none

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

    Files of custom code that a YAML file names are run; they are looked for in its folder, then in the current folder.
    """
    if name in built_in():
        return parse(name, read_yaml(built_in()[name]))
    path = Path(name)
    if path.suffix in (".yaml", ".yml") or os.path.isfile(path):
        return parse(str(path), read_yaml(path), (path.parent, Path()))
    raise unknown("search space (or YAML file)", name, built_in())
