"""What the paper claims, sentence by sentence, as comparisons of two agents on a target."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal


@dataclass(frozen=True)
class Arm:
    """An agent as a claim means it; of several configurations that fit, the one with the best mean AUC."""

    agent: str
    settings: tuple[tuple[str, Any], ...] = ()
    """Hyperparameters that it has, as pairs of name and value."""

    def __str__(self) -> str:
        """'delta_gate (threshold=10)'."""
        said = ", ".join(f"{name}={value}" for name, value in self.settings)
        return f"{self.agent} ({said})" if said else self.agent


@dataclass(frozen=True)
class Comparison:
    """One testable part of a claim, on one target."""

    target: str
    better: Arm
    worse: Arm
    kind: Literal["above", "no worse"] = "above"
    """above: the first is better than the second; no worse: it is at most MARGIN of the second's AUC below it."""
    column: Literal["auc", "first_tenth", "range", "log_variance"] = "auc"
    """The statistic: AUC, or the AUC of the first tenth of the training (a jumpstart). Of Figure 4, per source network:
    the range of the mean AUCs over SHARES, or the logarithm of the AUC's variance over seeds, averaged over them."""
    shares: bool = False
    """Whether it is about the cells of Figure 4, with several shares of the training with advice."""


@dataclass(frozen=True)
class Claim:
    """A sentence of the paper, and the comparisons that it stands on."""

    name: str
    sentence: str
    """Quoted from the paper."""
    where: str
    parts: tuple[Comparison, ...]


SHARES = (0.25, 0.5, 1.0)
"""Figure 4's shares of the training with advice."""

MARGIN = 0.05
"""A loss of at most this share of the baseline's AUC counts as none."""

DQN, ES, DELTA_ES = Arm("dqn"), Arm("es"), Arm("delta_es")
WARM_START = Arm("warm_start", (("last_layer", "source"),))
Q, PPR, REUSE = Arm("q_learning"), Arm("ppr", (("nu", 0.99),)), Arm("policy_reuse")
GATE, SUPPLY_GATE = (Arm("delta_gate", (("threshold", at),)) for at in (10.0, 5.0))

WIND = "windy_gridworld:wind="
SMALL, REVERSED = f"{WIND}small", f"{WIND}reversed"
DEMANDS = ("supply_chain:demand_mean=2", "supply_chain:demand_mean=5")
X5, X7 = "cartpole:gravity=5x", "cartpole:gravity=7x"
LONG, LONGER = "acrobot:link_mass=1.5", "acrobot:link_mass=2"
HEAVY, HEAVIER, LIGHT = "lunar_lander:mass=1.1", "lunar_lander:mass=1.5", "lunar_lander:mass=0.75"
PUSHED = ("reacher:y_force=0.75", "reacher:y_force=1")

SHORT, LONG_ADVICE = (Arm("delta_es", (("advice_fraction", at),)) for at in (SHARES[0], SHARES[-1]))

CLAIMS = (
    Claim(
        "reuse",
        "for cases where positive gains from transfer are possible, like Windy Gridworld scenario 1, the algorithm "
        "learns to directly reuse the source policy very quickly",
        "Figure 2",
        (Comparison(SMALL, GATE, Q),),
    ),
    Claim(
        "avoidance",
        "for cases like Windy Gridworld scenario 2 [...] the algorithm learn to conservatively select the current "
        "target policy and avoid the reuse of the source policy",
        "Figure 2",
        (Comparison(REVERSED, GATE, REUSE), Comparison(REVERSED, GATE, Q, "no worse")),
    ),
    Claim(
        "jumpstart",
        "For both scenarios for SCM environment, the algorithm learns to achieve an initial jumpstart",
        "Figure 2",
        tuple(Comparison(demand, SUPPLY_GATE, Q, column="first_tenth") for demand in DEMANDS),
    ),
    Claim(
        "both baselines",
        "The algorithm, in general, improves over both the no-transfer condition (Q-learning) and probabilistic policy "
        "reuse",
        "Figure 2",
        (
            *(Comparison(target, GATE, other) for target in (SMALL, REVERSED) for other in (Q, PPR)),
            *(Comparison(target, SUPPLY_GATE, other) for target in DEMANDS for other in (Q, PPR)),
        ),
    ),
    Claim(
        "on average",
        "adding the delta-based term maintains or improves performance of explicit shaping with respect to tr on "
        "average",
        "Table 1",
        tuple(Comparison(target, DELTA_ES, ES, "no worse") for target in (X5, X7, LONG, LONGER, HEAVY, LIGHT, *PUSHED)),
    ),
    Claim(
        "CartPole 5x",
        "for CartPole, the proposed modifications maintain the benefits when it is useful to transfer",
        "Table 1",
        (Comparison(X5, ES, DQN), Comparison(X5, DELTA_ES, DQN)),
    ),
    Claim(
        "CartPole 7x",
        "A positive transfer is maintained by the algorithm augmented with delta when the source information is "
        "slightly detrimental too [...] whereas the explicit shaping algorithm results in negative transfer",
        "Table 1",
        (Comparison(X7, DELTA_ES, DQN), Comparison(X7, DQN, ES)),
    ),
    Claim(
        "sensitivity to C",
        "average performance of delta-based explicit shaping is similar across different values of C while the "
        "explicit shaping algorithm is relatively more sensitive to C and has higher variances across different runs",
        "Figure 4",
        (
            Comparison(X5, SHORT, LONG_ADVICE, "no worse", shares=True),
            Comparison(X5, LONG_ADVICE, SHORT, "no worse", shares=True),
            Comparison(X5, ES, DELTA_ES, column="range", shares=True),
            Comparison(X5, ES, DELTA_ES, column="log_variance", shares=True),
        ),
    ),
    Claim(
        "Acrobot 1.5",
        "For Acrobot with link mass 1.5 times that of the source task, the delta based algorithm improves slightly on "
        "the benefits that transfer provides",
        "Table 1",
        (Comparison(LONG, ES, DQN), Comparison(LONG, DELTA_ES, ES)),
    ),
    Claim(
        "Acrobot 2",
        "the addition of delta prevents the negative transfer and performs similarly to the DQN baseline whereas the "
        "explicit shaping algorithm results in negative transfer",
        "Table 1",
        (Comparison(LONGER, DQN, ES), Comparison(LONGER, DELTA_ES, DQN, "no worse")),
    ),
    Claim(
        "LunarLander",
        "For LunarLander, the explicit shaping mechanism fails partially in both the transfer learning scenarios, "
        "whereas there is still some positive gains due to using the additional factor based on delta",
        "Table 1",
        tuple(
            part
            for target in (HEAVY, LIGHT)
            for part in (Comparison(target, DQN, ES), Comparison(target, DELTA_ES, DQN))
        ),
    ),
    Claim(
        "Reacher",
        "For the discretized version of Reacher, the algorithm augmented with delta maintains the positive bias from "
        "transfer for both transfer learning scenarios",
        "Table 1",
        tuple(Comparison(target, DELTA_ES, DQN) for target in PUSHED),
    ),
)
