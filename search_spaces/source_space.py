"""Where knowledge comes from in a search space: the source task, and the target tasks that it goes to."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field

from search_spaces.domains import Options, Strict
from search_spaces.limits import MAX_LIBRARY, MAX_TARGETS
from search_spaces.seeds import Seed, Seeds
from trainables.tasks.registry import parse_task


def default_pick(task: str) -> str:
    """Return the pick of a source task for which the search space names none."""
    return "own_seed" if parse_task(task).tabular else "best_evaluated"


def many(value: object) -> object:
    """Return a list from YAML as the tuple that it is read into."""
    return tuple(value) if isinstance(value, list) else value


Names = Annotated[tuple[str, ...], Field(min_length=1, max_length=MAX_TARGETS), BeforeValidator(many)]
Kinds = Annotated[tuple[Literal["learned", "exact"], ...], Field(min_length=1), BeforeValidator(many)]
Hyperparameters = dict[str, Options]


class SourceSpace(Strict):
    """Stage 1 of a scenario: the source tasks, and how their knowledge is obtained."""

    task: str
    library: Annotated[tuple[str, ...], Field(max_length=MAX_LIBRARY), BeforeValidator(many)] = ()
    """Further source tasks, for agents that choose among several sources (delta_select); other agents use `task` only.
    Each is trained like `task`. A target that is in the library is not a source for itself."""
    agent: str = "q_learning"
    kinds: Kinds = ("learned",)
    """learned: trained by `agent` with the best of `hyperparameters`; exact: value iteration (tabular tasks)."""
    hyperparameters: Hyperparameters = Field(default_factory=dict)
    """What stage 1 sweeps. Stage 2 uses the best values by mean AUC."""
    seeds: Seeds | None = None
    """Seeds that the source tasks are trained with; default: those of the sweep, with `seeds: auto` its first group."""
    pick: Literal["own_seed", "best_evaluated", "ranked", "each"] | Seed | None = None
    """The knowledge that a target seed gets. own_seed: the last of the same source seed; best_evaluated: the network
    with the best greedy evaluation of all source seeds; ranked: the network whose |delta| on the target is smallest
    along its own path there, which costs some episodes of the target for each network; a number: the best of that seed;
    each: that of every source seed in turn, a cell per target seed and source seed, so that the source is a random
    factor like the seed. Default: own_seed for tabular tasks, best_evaluated for deep ones."""

    @property
    def tasks(self) -> tuple[str, ...]:
        """The source task, then those of the library."""
        return (self.task, *self.library)

    @property
    def whose(self) -> str:
        """`pick` as text, the default filled in."""
        return default_pick(self.task) if self.pick is None else str(self.pick)

    def trained(self, seeds: tuple[int, ...]) -> tuple[int, ...]:
        """Return the seeds of stage 1, where the sweep's are `seeds`."""
        return seeds if self.seeds is None else self.seeds

    def check_pick(self, seeds: tuple[int, ...], trained: tuple[int, ...]) -> None:
        """Raise ValueError where a seed of `seeds` would get the knowledge of a source seed that is not `trained`."""
        if isinstance(self.pick, int) and self.pick not in trained:
            raise ValueError(f"source.pick must be one of the seeds (got {self.pick})")
        lacking = [seed for seed in seeds if seed not in trained]
        if self.whose == "own_seed" and "learned" in self.kinds and lacking:
            raise ValueError(f"source.seeds lacks {lacking[0]}, whose own source source.pick own_seed asks for")


class Scenario(Strict):
    """A source task and the target tasks to which its knowledge is transferred."""

    source: SourceSpace
    targets: Names
