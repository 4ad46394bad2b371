"""The statistics that the report draws over training, besides the returns."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Plot:
    """One statistic over training."""

    statistic: str
    """Its name in the statistics that the learner reports at each evaluation."""
    title: str
    axis: str
    share: bool = False
    """Whether it lies between 0 and 1."""
    level: str = ""
    """A hyperparameter that is drawn as a horizontal line, such as the threshold of the statistic."""


GATE_OPEN = Plot("gate_open_share", "share of steps with the gate open", "share of steps", share=True)
SOURCE_ACTION = Plot("source_action_share", "share of steps with the source's action", "share of steps", share=True)
KAPPA = Plot("kappa", "kappa, the weight of advice", "kappa", share=True)
ADVICE_FACTOR = Plot("advice_factor", "advice factor, kappa exp(−max |delta|)", "advice factor", share=True)
MAX_DELTA = Plot("max_abs_delta", "max |delta|", "max |delta|", level="threshold")
DELTA_P90 = Plot("delta_p90", "90 % quantile of max |delta|", "max |delta|")
DELTA_FACTOR = Plot("delta_factor", "delta's factor at remembered states, without kappa", "factor", share=True)
CORRECTED = Plot("corrected_share", "share of states where delta changes the source's action", "share", share=True)
GUIDE_STEPS = Plot("guide_steps", "steps that the source takes at the start of an episode", "steps")
PSI = Plot("psi", "psi, the probability of the source's action", "psi", share=True)
KNOWN = Plot("known", "how far the remembered states are known", "share", share=True)
TRANSFER_LEADS = Plot("transfer_leads", "whether the transferred network leads", "leads", share=True)
GIVEN_UP = Plot("given_up", "whether the transferred network was given up", "given up", share=True)
PROBE_DIFFERENCE = Plot("probe_difference", "return of the transferred network less that from scratch", "return")
