"""The agents that have a name. Add one: its hyperparameters, its learner, and a line in AGENTS."""

from __future__ import annotations

from trainables.agents import custom
from trainables.agents import hyperparameters as hp
from trainables.agents.agent import Agent
from trainables.agents.plots import ADVICE_FACTOR, DELTA_P90, GATE_OPEN, KAPPA, MAX_DELTA, SOURCE_ACTION
from trainables.errors import unknown
from trainables.plugins import entry_points

__all__ = ["AGENTS", "Agent", "agent_named", "agents"]


_LEARNER = "trainables.learners.q_learning:TabularLearner"
_DEEP = "trainables.learners.dqn:DeepLearner"
_SELECT = "trainables.learners.delta_select:SelectLearner"
_DEEP_SELECT = "trainables.learners.delta_select_es:DeepSelectLearner"

_ADVICE = (KAPPA, ADVICE_FACTOR)

AGENTS: dict[str, Agent] = {
    agent.name: agent
    for agent in (
        Agent("q_learning", "Q-learning without transfer", hp.QLearning, None, _LEARNER, usual=True, look="grey"),
        Agent(
            "policy_reuse",
            "the source policy, unchanged (direct reuse)",
            hp.Transfer,
            "q_learning",
            _LEARNER,
            usual=True,
            look="orange",
            plots=(MAX_DELTA,),
        ),
        Agent(
            "ppr",
            "probabilistic policy reuse",
            hp.ProbabilisticPolicyReuse,
            "q_learning",
            _LEARNER,
            shown=("nu",),
            usual=True,
            look="blue",
            plots=(SOURCE_ACTION, MAX_DELTA),
        ),
        Agent(
            "delta_gate",
            "Algorithm 1: the source policy while max |delta| <= threshold",
            hp.DeltaGate,
            "q_learning",
            _LEARNER,
            shown=("threshold",),
            usual=True,
            algorithm=1,
            look="vermilion",
            plots=(GATE_OPEN, MAX_DELTA),
            own_scale=(),
        ),
        Agent(
            "confidence_gate",
            "Algorithm 1 with a gate that asks for significance",
            hp.ConfidenceGate,
            "q_learning",
            _LEARNER,
            shown=("threshold",),
            usual=True,
            look="green",
            plots=(GATE_OPEN, MAX_DELTA),
        ),
        Agent(
            "q_warm_start",
            "Q-learning that starts from Q_src",
            hp.Transfer,
            "q_learning",
            _LEARNER,
            look="pink",
            plots=(MAX_DELTA,),
        ),
        Agent(
            "delta_select",
            "of several sources the one with the smallest delta along its own path, or none",
            hp.DeltaSelect,
            "q_learning",
            _SELECT,
            several=True,
            look="sky",
            plots=(SOURCE_ACTION,),
        ),
        Agent("dqn", "deep Q-learning without transfer", hp.DQN, None, _DEEP, "deep", usual=True, look="grey"),
        Agent(
            "es",
            "explicit shaping: acts on Q + kappa A_src",
            hp.ExplicitShaping,
            "dqn",
            _DEEP,
            "deep",
            shown=("advice_fraction",),
            usual=True,
            look="blue",
            plots=_ADVICE,
        ),
        Agent(
            "delta_es",
            "Algorithm 2: explicit shaping scaled by delta",
            hp.DeltaShaping,
            "dqn",
            _DEEP,
            "deep",
            shown=("advice_fraction",),
            usual=True,
            algorithm=2,
            look="vermilion",
            plots=(*_ADVICE, DELTA_P90),
        ),
        Agent(
            "delta_select_es",
            "explicit shaping by that of several sources whose delta is smallest, or none",
            hp.DeltaSelectShaping,
            "dqn",
            _DEEP_SELECT,
            "deep",
            several=True,
            shown=("advice_fraction", "threshold"),
            look="green",
            plots=_ADVICE,
        ),
        Agent(
            "dpba",
            "potential-based advice: reward shaping by A_src",
            hp.PotentialAdvice,
            "dqn",
            _DEEP,
            "deep",
            look="sky",
            plots=_ADVICE,
        ),
        Agent(
            "delta_dpba",
            "potential-based advice scaled by delta",
            hp.DeltaPotentialAdvice,
            "dqn",
            _DEEP,
            "deep",
            look="pink",
            plots=(*_ADVICE, DELTA_P90),
        ),
    )
}


def agents() -> dict[str, Agent]:
    """The registered agents by name, those of installed packages included; InputError where a name is taken twice."""
    entry_points.check_names("agent", AGENTS)
    return AGENTS | {name: agent_named(name) for name in entry_points.names("agent")}


def agent_named(name: str) -> Agent:
    """The agent called `name`; InputError with the list of what there is.

    A name of own code whose file or package is not there gives a stand-in, which can be read of and not trained.
    """
    if name in AGENTS:
        return AGENTS[name]
    found = custom.agent(name)
    if found is None:
        raise unknown("agent", name, [*AGENTS, *entry_points.names("agent")])
    return found
