"""A cell: one (agent, task, source, hyperparameters, seed), the unit of work, of resume and of reproducibility."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from trainables.agents.agent import Agent
from trainables.agents.base import Hyperparameters
from trainables.agents.registry import agent_named
from trainables.errors import InputError, from_validation
from trainables.tasks.registry import parse_task

SCHEMA = 1
"""Version of the cell's JSON and of its results: a change of the arithmetic raises it, and changes every id."""

ID_LENGTH = 16


def content_id(data: object) -> str:
    """Return the first 64 bits of the SHA-256 of canonical JSON, in hexadecimal."""
    text = json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:ID_LENGTH]


class Source(BaseModel):
    """Where a cell's source knowledge comes from."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    task: str
    """The source task."""
    kind: Literal["learned", "exact"]
    """Trained by the cell `cell_id`, or by value iteration (tabular tasks)."""
    cell_id: str | None = None
    """The cell that trained it; None for an exact source."""
    checkpoint: Literal["last", "best"] = "last"
    """Its last network, or the one with the best greedy evaluation (deep agents)."""
    steps: int | None = None
    """T, the training steps of the source run with this cell's seed (for the decay constant C of deep agents)."""


class _Stored(BaseModel):
    """A cell's JSON: its first source, and further ones in `library` for an agent that chooses among several."""

    model_config = ConfigDict(extra="forbid", strict=True)

    agent: str
    task: str
    seed: Annotated[int, Field(ge=0)]
    hyperparameters: dict[str, float | int | str | bool]
    source: Source | None = None
    library: Annotated[tuple[Source, ...], Field(strict=False)] = ()


class Cell(BaseModel):
    """Everything that determines a result, and nothing else. Build one with `Cell.create`."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    agent: str
    task: str
    seed: Annotated[int, Field(ge=0)]
    hyperparameters: dict[str, float | int | str | bool]
    """All hyperparameters, defaults included."""
    sources: tuple[Source, ...] = ()
    """The sources that it uses: none, one, or several for an agent that chooses among them."""

    @classmethod
    def create(
        cls,
        agent: str,
        task: str,
        seed: int,
        hyperparameters: dict[str, Any] | None = None,
        source: Source | Iterable[Source] | None = None,
    ) -> Cell:
        """Return a checked cell with canonical names and all hyperparameters.

        source: several for an agent that chooses among them. Raises InputError for anything unknown, out of range, or
        missing (a source, for an agent that needs one).
        """
        named, parsed = agent_named(agent), parse_task(task)
        full = named.resolve(parsed, hyperparameters or {}).model_dump()
        sources = _checked_sources(named, () if source is None else (source,) if isinstance(source, Source) else source)
        try:
            return cls(agent=named.name, task=parsed.name, seed=seed, hyperparameters=full, sources=sources)
        except ValidationError as error:
            raise from_validation("cell", error) from None

    @functools.cached_property
    def id(self) -> str:
        """The content hash; equal cells, and only they, have equal ids."""
        return content_id(self.to_json())

    @property
    def source_key(self) -> str:
        """The key of the sources' knowledge within a stage; empty for a cell without source."""
        keys = [source.cell_id or f"exact:{source.task}:{self.hyperparameters['gamma']!r}" for source in self.sources]
        return keys[0] if len(keys) == 1 else f"library:{content_id(keys)}" if keys else ""

    @property
    def settings(self) -> Hyperparameters:
        """The hyperparameters as an instance of the agent's class."""
        return agent_named(self.agent).resolve(parse_task(self.task), dict(self.hyperparameters))

    @property
    def episodes(self) -> int:
        """How many episodes it trains; `settings.episodes` without a check of all settings."""
        return int(self.hyperparameters["episodes"])

    @functools.cached_property
    def group(self) -> str:
        """The id that the cell shares with its other seeds: agent, task, kind of source and hyperparameters."""
        kinds = [[source.task, source.kind, source.checkpoint] for source in self.sources]
        shared = [self.agent, self.task, kinds[0] if kinds else None, self._written()]
        return content_id([*shared, kinds[1:]] if len(kinds) > 1 else shared)

    @functools.cached_property
    def lineage(self) -> str:
        """The id that the cell shares with those that differ from it only in how many episodes they train."""
        data = self.to_json()
        del data["hyperparameters"]["episodes"]
        return content_id(data)

    def with_episodes(self, episodes: int) -> Cell:
        """Return the cell that differs only in how many episodes it trains. Raises InputError for a wrong number."""
        return Cell.create(
            self.agent, self.task, self.seed, self.hyperparameters | {"episodes": episodes}, self.sources
        )

    def _written(self) -> dict[str, float | int | str | bool]:
        """Return the hyperparameters without later additions at their earlier values, so that ids stay the same."""
        unwritten = agent_named(self.agent).hyperparameters.unwritten
        return {name: value for name, value in self.hyperparameters.items() if unwritten.get(name) != value}

    def to_json(self) -> dict[str, Any]:
        """Return the cell as plain data, with its schema version."""
        data = self.model_dump() | {"hyperparameters": self._written()}
        first, *library = data.pop("sources") or (None,)
        return {"schema": SCHEMA, **data, "source": first} | ({"library": library} if library else {})

    @classmethod
    def from_json(cls, data: object) -> Cell:
        """Return the cell that `to_json` wrote. Raises InputError for anything else, or another schema version."""
        if not isinstance(data, dict):
            raise InputError(f"a cell must be an object (got {data!r})")
        if data.get("schema") != SCHEMA:
            raise InputError(f"a cell's schema must be {SCHEMA} (got {data.get('schema')!r})")
        try:
            raw = _Stored.model_validate({key: value for key, value in data.items() if key != "schema"})
        except ValidationError as error:
            raise from_validation("cell", error) from None
        if raw.library and raw.source is None:
            raise InputError("a cell with a library needs a source")
        sources = () if raw.source is None else (raw.source, *raw.library)
        values = {**agent_named(raw.agent).hyperparameters.unwritten, **raw.hyperparameters}
        return cls.create(raw.agent, raw.task, raw.seed, values, sources)


def _checked_sources(agent: Agent, sources: Iterable[Source]) -> tuple[Source, ...]:
    """Return the sources with canonical names. Raises InputError for too many, too few, unfit or repeated ones."""
    found = tuple(sources)
    if agent.needs_source and not found:
        raise InputError(f"{agent.name} needs a source task")
    if not agent.needs_source and found:
        raise InputError(f"{agent.name} takes no source (got {found[0].task})")
    found = tuple(_checked(source, agent.kind) for source in found)
    if len(found) > 1 and not agent.several:
        raise InputError(f"{agent.name} takes one source (got {', '.join(source.task for source in found)})")
    if len(set(found)) < len(found):
        raise InputError(f"{agent.name} has a source twice")
    return found


def _checked(source: Source, kind: str) -> Source:
    task = parse_task(source.task)
    if source.kind == "exact" and not (task.tabular and kind == "tabular"):
        raise InputError(f"an exact source needs a tabular task (got {task.name})")
    if (source.kind == "learned") != (source.cell_id is not None):
        raise InputError(f"the {source.kind} source {'needs a' if source.kind == 'learned' else 'has no'} cell id")
    return source.model_copy(update={"task": task.name})
