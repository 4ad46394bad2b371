"""The agents that have a name. Add one: its hyperparameters, its learner, and a line in AGENTS."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import ValidationError

from trainables.agents import hyperparameters as hp
from trainables.agents import own_agent
from trainables.errors import InputError, from_validation, unknown
from trainables.plugins import installed
from trainables.tasks import Task, families

__all__ = ["AGENTS", "Agent", "agent_named", "agents"]


@dataclass(frozen=True)
class Agent:
    """What is registered under a name."""

    name: str
    description: str
    hyperparameters: type[hp.Hyperparameters]
    base: str | None
    """The agent without transfer that this one is compared with and whose source it uses; None: it is one itself."""
    learner: str | Callable[..., Any]
    """The learner's class, or the `module:Class` of one that is imported when a cell is trained."""
    kind: Literal["tabular", "deep"] = "tabular"
    origin: Literal["built-in", "own", "missing"] = "built-in"
    """Whose it is: deltatune's, the user's, or a user's whose code is not loaded."""
    several: bool = False
    """Whether it chooses among several sources: a cell of it may name a library beside the source."""

    @property
    def needs_source(self) -> bool:
        """Whether a cell of this agent names a source."""
        return self.base is not None

    def resolve(self, task: Task, given: dict[str, object]) -> hp.Hyperparameters:
        """All hyperparameters for `task`: the given ones, then the task's own (Tables 4 to 7), then the defaults.

        Raises InputError for a wrong key, type or range, or where the agent cannot learn this task.
        """
        if "missing" in (self.origin, task.family.origin):
            pass
        elif self.kind == "tabular" and not task.tabular:
            tabular = [name for name, family in families().items() if family.model is not None]
            raise InputError(f"{self.name} needs a tabular task ({', '.join(tabular)}), which {task.name} is not")
        elif self.kind == "deep" and task.tabular:
            deep = [name for name, family in families().items() if family.model is None]
            raise InputError(f"{self.name} needs a task with vector observations ({', '.join(deep)}), not {task.name}")
        known = self.hyperparameters.model_fields
        own = {key: value for key, value in task.family.defaults.items() if key in known and self._takes(key)}
        for key in given:
            if key not in known and self.origin != "missing":
                raise unknown(f"hyperparameter of {self.name}", key, known)
        try:
            return self.hyperparameters.model_validate(own | given)
        except ValidationError as error:
            raise from_validation(self.name, error) from None

    def _takes(self, key: str) -> bool:
        """The paper's threshold per task is Algorithm 1's; the confidence gate's is on another scale."""
        return key != "threshold" or self.name == "delta_gate"


_LEARNER = "trainables.agents.q_learning:TabularLearner"
_DEEP = "trainables.agents.dqn:DeepLearner"
_SELECT = "trainables.agents.select:SelectLearner"
_DEEP_SELECT = "trainables.agents.dqn_select:DeepSelectLearner"

AGENTS: dict[str, Agent] = {
    agent.name: agent
    for agent in (
        Agent("q_learning", "Q-learning without transfer", hp.QLearning, None, _LEARNER),
        Agent("policy_reuse", "the source policy, unchanged (direct reuse)", hp.Transfer, "q_learning", _LEARNER),
        Agent("ppr", "probabilistic policy reuse", hp.ProbabilisticPolicyReuse, "q_learning", _LEARNER),
        Agent(
            "delta_gate",
            "Algorithm 1: the source policy while max |delta| <= threshold",
            hp.DeltaGate,
            "q_learning",
            _LEARNER,
        ),
        Agent(
            "confidence_gate",
            "Algorithm 1 with a gate that asks for significance",
            hp.ConfidenceGate,
            "q_learning",
            _LEARNER,
        ),
        Agent("q_warm_start", "Q-learning that starts from Q_src", hp.Transfer, "q_learning", _LEARNER),
        Agent(
            "delta_select",
            "of several sources the one with the smallest delta along its own path, or none",
            hp.DeltaSelect,
            "q_learning",
            _SELECT,
            several=True,
        ),
        Agent("dqn", "deep Q-learning without transfer", hp.DQN, None, _DEEP, "deep"),
        Agent("es", "explicit shaping: acts on Q + kappa A_src", hp.ExplicitShaping, "dqn", _DEEP, "deep"),
        Agent("delta_es", "Algorithm 2: explicit shaping scaled by delta", hp.DeltaShaping, "dqn", _DEEP, "deep"),
        Agent(
            "delta_select_es",
            "explicit shaping by that of several sources whose delta is smallest, or none",
            hp.DeltaSelectShaping,
            "dqn",
            _DEEP_SELECT,
            "deep",
            several=True,
        ),
        Agent("dpba", "potential-based advice: reward shaping by A_src", hp.PotentialAdvice, "dqn", _DEEP, "deep"),
        Agent(
            "delta_dpba",
            "potential-based advice scaled by delta",
            hp.DeltaPotentialAdvice,
            "dqn",
            _DEEP,
            "deep",
        ),
    )
}


def agents() -> dict[str, Agent]:
    """The registered agents by name, those of installed packages included; InputError where a name is taken twice."""
    installed.check_names("agent", AGENTS)
    return AGENTS | {name: agent_named(name) for name in installed.names("agent")}


def agent_named(name: str) -> Agent:
    """The agent called `name`; InputError with the list of what there is.

    A name of own code whose file or package is not there gives a stand-in, which can be read of and not trained.
    """
    if name in AGENTS:
        return AGENTS[name]
    found = own_agent.agent(name)
    if found is None:
        raise unknown("agent", name, [*AGENTS, *installed.names("agent")])
    return found
