"""The hyperparameters of every agent, and the types of ranges for those of custom agents."""

from trainables.agents.base import Count, Hyperparameters, NonNegative, Positive, Probability, Rate
from trainables.agents.builtin.delta_select import DeltaSelect
from trainables.agents.builtin.delta_select_es import DeltaSelectShaping
from trainables.agents.builtin.dqn import DQN
from trainables.agents.builtin.explicit_shaping import DeltaShaping, ExplicitShaping
from trainables.agents.builtin.gates import ConfidenceGate, DeltaGate, Threshold
from trainables.agents.builtin.potential_advice import DeltaPotentialAdvice, PotentialAdvice
from trainables.agents.builtin.ppr import ProbabilisticPolicyReuse
from trainables.agents.builtin.q_learning import PolicyReuse, QLearning, Transfer, WarmStart

__all__ = [
    "DQN",
    "ConfidenceGate",
    "Count",
    "DeltaGate",
    "DeltaPotentialAdvice",
    "DeltaSelect",
    "DeltaSelectShaping",
    "DeltaShaping",
    "ExplicitShaping",
    "Hyperparameters",
    "NonNegative",
    "PolicyReuse",
    "Positive",
    "PotentialAdvice",
    "ProbabilisticPolicyReuse",
    "Probability",
    "QLearning",
    "Rate",
    "Threshold",
    "Transfer",
    "WarmStart",
]
