"""The search space that a command line means."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from search_spaces.search_space import SearchSpace


def space_of(space: str | None, storage: Path, name: str | None) -> SearchSpace:
    """Return the search space that the user names, else that of the last run of the sweep `name` in `storage`.

    Raises InputError as `named_space` and `Results.open` do, and where neither is given.
    """
    from orchestrator.results.sweep_folder import Results
    from trainables.errors import InputError
    from trainables.storage.folders import absolute

    if space is not None:
        return named_space(space)
    if name is None:
        raise InputError("sweep requires a search space, or the --name of a sweep to continue (see 'deltatune spaces')")
    results = Results.open(storage, name)
    if results.storage != absolute(storage):  # `open` also takes a folder that is somewhere else
        raise InputError(f"no sweep '{name}' in {storage}; the one in {results.storage} needs --storage")
    return results.space()


def named_space(text: str) -> SearchSpace:
    """Return the search space that `text` names. Raises InputError, which suggests `init` where it names a task."""
    from search_spaces.loading import built_in, load
    from trainables.errors import InputError
    from trainables.plugins.names import by_file
    from trainables.tasks.registry import families

    if text not in built_in() and (text.startswith("gym:") or by_file(text) or text.partition(":")[0] in families()):
        raise InputError(
            f"'{text}' is a task, not a search space: write one for it with deltatune init '{text}' -o mine.yaml"
        )
    return load(text)
