"""The schema of a search space: what to sweep, as plain data, in Python or YAML."""

from __future__ import annotations

import functools
import itertools
import logging
import math
from math import prod
from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from search_spaces.domains import Grid, Range, Strict
from search_spaces.limits import (
    MAX_CELLS,
    MAX_CONFIGURATIONS,
    MAX_SCENARIOS,
    MAX_SEEDS,
    twice,
)
from search_spaces.seeds import Seed, Sequential, SweepSeeds, spelled_out
from search_spaces.source_space import Hyperparameters, Scenario, SourceSpace, many
from trainables.agents.agent import Agent
from trainables.agents.registry import agent_named
from trainables.errors import shown
from trainables.tasks.make import make_env
from trainables.tasks.registry import parse_task
from trainables.tasks.spec.family import Task

log = logging.getLogger("deltatune.search_spaces")

FIRST_UNSEEN_SEED = 1_000_000
"""The seeds of a confirmation begin here."""


def _reference(value: object) -> object:
    """Return [0's return, 1's return] as a pair."""
    pair = tuple(value) if isinstance(value, list | tuple) else ()
    numbers = all(isinstance(end, int | float) and math.isfinite(end) for end in pair)
    if not numbers or len(pair) != 2 or not pair[0] < pair[1]:
        raise ValueError(f"must be two returns, the lower one first, such as [20, 195] (got {shown(value)})")
    return pair


Reference = Annotated[
    tuple[float, float],
    BeforeValidator(_reference, json_schema_input_type=Annotated[list[float], Field(min_length=2, max_length=2)]),
]


class Scheduler(Strict):
    """Early stopping of all seeds of a configuration together, by their mean greedy return so far.

    A configuration competes only within its arm: the same task, agent and source. A stopped configuration has no AUC.
    """

    method: Literal["asha", "median"]
    """asha: asynchronous successive halving; median: stop what is below the median of the others' means."""
    grace: Annotated[int, Field(ge=1)] = 5
    """Evaluations before a configuration may be stopped."""
    reduction_factor: Annotated[int, Field(ge=2)] = 3
    """asha: one in this many continues from each rung."""


class Search(Strict):
    """How ranges are searched: `budget` configurations for each task, agent and source."""

    method: Literal["grid", "random", "optuna"] = "grid"
    budget: Annotated[int, Field(ge=1, le=MAX_CONFIGURATIONS)] = 20
    seed: Seed = 0
    scheduler: Scheduler | None = None
    """Early stopping; null: every configuration is trained to its end."""


class Confirm(Strict):
    """Run the selected configuration of each arm, and its baseline, again on seeds that had no part in selecting it."""

    seeds: Annotated[int, Field(ge=1, le=MAX_SEEDS)]
    """How many unseen seeds; they are numbered from 1,000,000 on."""


class SearchSpace(Strict):
    """What to sweep: scenarios, agents with their hyperparameters, seeds, and the search method."""

    schema_version: Literal[1] = Field(alias="schema")
    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
    family: Annotated[str, Field(pattern=r"^[A-Za-z0-9_. -]{0,64}$")] = ""
    """The MLflow experiment; default: the name."""
    description: str = ""
    seeds: SweepSeeds
    """A list of seeds, how many, or auto: as many as a sequential test asks for."""
    scenarios: Annotated[tuple[Scenario, ...], Field(min_length=1, max_length=MAX_SCENARIOS), BeforeValidator(many)]
    agents: Annotated[dict[str, Hyperparameters], Field(min_length=1)]
    """Stage 2: each agent with its hyperparameters to sweep."""
    hyperparameters: Hyperparameters = Field(default_factory=dict)
    """For every agent of both stages that has them, e.g. {episodes: 500}."""
    search: Search = Search()
    confirm: Confirm | None = None
    """Judge what was selected on unseen seeds; None: on the seeds that selected it, which is biased in its favour."""
    sequential: Sequential | None = None
    """The sequential test of `seeds: auto`, of which `seeds` are then the budget; null: every seed runs."""
    normalise: dict[str, Reference] = Field(default_factory=dict)
    """Task, or a task family for all of its tasks, to the returns that count as 0 and as 1 where scores of several
    tasks are put together: e.g. those of a random policy and of a solution."""

    @model_validator(mode="before")
    @classmethod
    def _spelled_out(cls, data: object) -> object:
        return spelled_out(data)

    @field_validator("normalise", mode="after")
    @classmethod
    def _canonical(cls, value: dict[str, Reference]) -> dict[str, Reference]:
        named = {name: parse_task(name).name for name in value}
        _once("normalise", list(named.values()))
        return {named[name]: pair for name, pair in value.items()}

    @model_validator(mode="after")
    def _consistent(self) -> SearchSpace:
        _check_sequential(self)
        _check_size(self)
        _once("seeds", [str(seed) for seed in self.seeds])
        for scenario in self.scenarios:
            source, targets = parse_task(scenario.source.task), [parse_task(name) for name in scenario.targets]
            _once("targets", [target.name for target in targets])
            library = [parse_task(name) for name in scenario.source.library]
            _once("source.library, with source.task", [source.name, *(other.name for other in library)])
            if library and not any(agent_named(name).several for name in self.agents):
                raise ValueError("source.library is for an agent that chooses among several sources: add delta_select")
            for target, other in itertools.product(targets, [source, *library]):
                _check_shapes(other, target)
            base = agent_named(scenario.source.agent)
            if base.needs_source:
                raise ValueError(f"source.agent must learn without a source (got {base.name})")
            _once("source.seeds", [str(seed) for seed in self.source_seeds(scenario.source)])
            scenario.source.check_pick(self.seeds, self.source_seeds(scenario.source))
            self._check_agent(base, scenario.source.hyperparameters, [source, *library])
            for name, options in self.agents.items():
                self._check_agent(agent_named(name), options, targets)
        return self

    def _check_agent(self, agent: Agent, specific: Hyperparameters, tasks: list[Task]) -> None:
        """Check that the agent takes every value that may be tried, on each task."""
        known = agent.hyperparameters.model_fields
        shared = {key: option for key, option in self.hyperparameters.items() if key in known}
        for key, option in {**shared, **specific}.items():
            if isinstance(option, Range) and self.search.method == "grid":
                raise ValueError(f"{agent.name}.{key} is a range: add search: {{method: random}} or {{method: optuna}}")
            for value in option.ends() if isinstance(option, Range) else option.values:
                for task in tasks:
                    agent.resolve(task, {key: value})
        for key in self.hyperparameters:
            if not any(key in agent_named(name).hyperparameters.model_fields for name in self.agents):
                raise ValueError(f"hyperparameters.{key} is known to none of the agents ({', '.join(self.agents)})")

    def source_seeds(self, source: SourceSpace) -> tuple[int, ...]:
        """Return the seeds that a source is trained with in stage 1.

        With a sequential test the source must not depend on how many seeds it takes: default the first group, or the
        whole budget where each seed has a source of its own.
        """
        if self.sequential is None or source.whose == "own_seed":
            return source.trained(self.seeds)
        return source.trained(self.seeds[: self.sequential.group])

    @property
    def every_seed(self) -> tuple[int, ...]:
        """The seeds of the target cells, then the other seeds of source cells."""
        sources = (self.source_seeds(scenario.source) for scenario in self.scenarios)
        return tuple(dict.fromkeys(itertools.chain(self.seeds, *sources)))

    @property
    def confirm_seeds(self) -> tuple[int, ...]:
        """The unseen seeds of the confirmation: the same ones however the sweep grows."""
        taken = set(self.every_seed)
        unseen = (seed for seed in itertools.count(FIRST_UNSEEN_SEED) if seed not in taken)
        return tuple(itertools.islice(unseen, self.confirm.seeds if self.confirm else 0))

    def to_json(self) -> dict[str, object]:
        """Return the space as plain data; `SearchSpace.model_validate(space.to_json()) == space`."""
        return self.model_dump(mode="json", by_alias=True)


def _check_sequential(space: SearchSpace) -> None:
    """Raise ValueError for what a sequential test over seeds cannot be combined with."""
    if space.sequential is None:
        return
    group, budget = space.sequential.group, len(space.seeds)
    if budget % group:
        raise ValueError(f"seeds: auto tests whole groups: max must be a multiple of group (got {budget} and {group})")
    if space.confirm:
        raise ValueError(
            "seeds: auto and confirm cannot be combined: auto tests every configuration, which leaves no selection to "
            "confirm"
        )
    if space.search.scheduler:
        raise ValueError("seeds: auto needs every curve to its end: take out search.scheduler (early stopping)")
    ranges = [
        f"{name}.{key}"
        for name, own in space.agents.items()
        for key, option in {**space.hyperparameters, **own}.items()
        if isinstance(option, Range) and key in agent_named(name).hyperparameters.model_fields
    ]
    if ranges:
        raise ValueError(f"seeds: auto compares settled configurations: {ranges[0]} is a range to search, give values")
    agents = [agent_named(name) for name in space.agents]
    if not any({agent.base, *agent.rivals} & space.agents.keys() for agent in agents):
        raise ValueError(
            f"seeds: auto compares agents, and none of {', '.join(agent.name for agent in agents)} builds on another"
        )


def _check_size(space: SearchSpace) -> None:
    """Raise ValueError where a search space has too many configurations or cells, without building them."""
    asked = 0
    for scenario in space.scenarios:
        source, seeds = scenario.source, len(space.seeds)
        trained = len(space.source_seeds(source))
        if source.hyperparameters or "learned" in source.kinds:
            tasks = len(source.tasks) if "learned" in source.kinds else 1
            asked += tasks * trained * _configurations(space, source.agent, source.hyperparameters)
        for agent, options in space.agents.items():
            kinds = [trained if source.pick == "each" and kind == "learned" else 1 for kind in source.kinds]
            crossed = sum(kinds) if agent_named(agent).needs_source else 1
            unseen = 2 * space.confirm.seeds if space.confirm else 0  # the selected configuration and its baseline
            each = seeds * _configurations(space, agent, options) + unseen
            asked += len(scenario.targets) * crossed * each
    if asked > MAX_CELLS:
        raise ValueError(f"it asks for {asked:,} cells, more than {MAX_CELLS:,}: take fewer values, tasks or seeds")


def _configurations(space: SearchSpace, agent: str, specific: Hyperparameters) -> int:
    known = agent_named(agent).hyperparameters.model_fields
    options = [option for name, option in {**space.hyperparameters, **specific}.items() if name in known]
    count = prod(len(option.values) for option in options if isinstance(option, Grid))
    if count > MAX_CONFIGURATIONS:
        raise ValueError(
            f"the grid of {agent} has {count:,} configurations, more than {MAX_CONFIGURATIONS:,}: take fewer values, "
            "or search: {method: random}"
        )
    return space.search.budget if any(isinstance(option, Range) for option in options) else count


def _once(what: str, names: list[str]) -> None:
    if found := twice(names):
        raise ValueError(f"{what}: {found[0]} is given twice")


def _check_shapes(source: Task, target: Task) -> None:
    """Check that source and target have the same states, or observations, and actions."""
    if source.family is target.family and source.family.origin == "built-in":
        return
    try:
        spaces = [_spaces(source.name), _spaces(target.name)]
    except Exception as error:  # custom code that is broken or missing: its cells will say why, the others run
        if {source.family.origin, target.family.origin} == {"built-in"}:
            raise
        log.info("the shapes of %s and %s cannot be compared: %s", source.name, target.name, error)
        return
    if spaces[0] != spaces[1]:
        raise ValueError(f"targets: {target.name} has {spaces[1]}, the source {source.name} {spaces[0]}")


@functools.cache
def _spaces(name: str) -> str:
    """Return a task's states, or the shape of its observations, and its actions, as text."""
    env = make_env(parse_task(name))
    states, actions = getattr(env.observation_space, "n", None), getattr(env.action_space, "n", None)
    shape = env.observation_space.shape
    env.close()
    return f"{states} states and {actions} actions" if states else f"observations {shape} and {actions} actions"
