"""The registry of agents. To add one: a module in `builtin`, and a line here (docs/extending.md)."""

from __future__ import annotations

from trainables.agents import custom
from trainables.agents.agent import Agent
from trainables.agents.builtin.baselines.ablations import CONSTANT_ES, SHUFFLED_ES
from trainables.agents.builtin.baselines.corrected_shaping import CORRECTED_ES
from trainables.agents.builtin.baselines.dqinit import DQINIT
from trainables.agents.builtin.baselines.jump_start import JSRL
from trainables.agents.builtin.baselines.kickstart import KICKSTART
from trainables.agents.builtin.baselines.ppr_dqn import PPR_DQN
from trainables.agents.builtin.baselines.relative_shaping import RELATIVE_ES
from trainables.agents.builtin.baselines.replay_seed import REPLAY_SEED
from trainables.agents.builtin.baselines.safe_start import SAFE_START
from trainables.agents.builtin.baselines.warm_start import WARM_START
from trainables.agents.builtin.delta_select import DELTA_SELECT
from trainables.agents.builtin.delta_select_es import DELTA_SELECT_ES
from trainables.agents.builtin.dqn import DQN_AGENT
from trainables.agents.builtin.explicit_shaping import DELTA_ES, ES
from trainables.agents.builtin.gates import CONFIDENCE_GATE, DELTA_GATE
from trainables.agents.builtin.potential_advice import DELTA_DPBA, DPBA
from trainables.agents.builtin.ppr import PPR
from trainables.agents.builtin.q_learning import POLICY_REUSE, Q_LEARNING, Q_WARM_START
from trainables.errors import unknown
from trainables.plugins import entry_points

__all__ = ["AGENTS", "Agent", "agent_named", "agents"]


AGENTS: dict[str, Agent] = {
    agent.name: agent
    for agent in (
        Q_LEARNING,
        POLICY_REUSE,
        PPR,
        DELTA_GATE,
        CONFIDENCE_GATE,
        Q_WARM_START,
        DELTA_SELECT,
        DQN_AGENT,
        ES,
        DELTA_ES,
        DELTA_SELECT_ES,
        DPBA,
        DELTA_DPBA,
        WARM_START,
        SAFE_START,
        CORRECTED_ES,
        RELATIVE_ES,
        JSRL,
        PPR_DQN,
        KICKSTART,
        REPLAY_SEED,
        DQINIT,
        CONSTANT_ES,
        SHUFFLED_ES,
    )
}
"""In the order of all lists and legends."""


def agents() -> dict[str, Agent]:
    """Return the agents by name, those of installed packages included. Raises InputError for a name taken twice."""
    entry_points.check_names("agent", AGENTS)
    return AGENTS | {name: agent_named(name) for name in entry_points.names("agent")}


def agent_named(name: str) -> Agent:
    """Return the agent called `name`. Raises InputError, with the list of agents, for an unknown name.

    A custom agent whose file or package is missing gives a placeholder, whose results can be read but not trained.
    """
    if name in AGENTS:
        return AGENTS[name]
    found = custom.agent(name)
    if found is None:
        raise unknown("agent", name, [*AGENTS, *entry_points.names("agent")])
    return found
