"""The best hyperparameters as keyword arguments of stable-baselines3's DQN, with notes on what differs there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.export.best_params import arm_entry
from trainables.agents.builtin.dqn import DQN
from trainables.agents.registry import agent_named

SAME = {
    "learning_rate": "learning_rate",
    "replay_capacity": "buffer_size",
    "batch_size": "batch_size",
    "gamma": "gamma",
    "target_update": "target_update_interval",
    "epsilon_start": "exploration_initial_eps",
    "epsilon_end": "exploration_final_eps",
    "max_gradient_norm": "max_grad_norm",
    "device": "device",
}
"""The name of a hyperparameter here to that of the equivalent argument of DQN."""

ELSEWHERE = {
    "initialisation": "Xavier here; stable-baselines3 keeps PyTorch's own",
    "epsilon_decay": "exponential here; exploration_fraction is the linear decay of the same mean, or else the slowest",
    "evaluate_every": "give it to an EvalCallback",
    "evaluation_episodes": "give it to an EvalCallback",
    "episodes": "give total_timesteps, the mean over seeds of the steps taken here, to learn()",
}
"""Hyperparameters of every deep agent that are no arguments of DQN, and what replaces them."""

ADVICE = "stable-baselines3 has no transfer: without it this is plain DQN"


def dqn_arguments(findings: Findings) -> dict[str, Any]:
    """Return the best configuration of each deep agent, task and source for `DQN("MlpPolicy", env, **kwargs)`."""
    steps = {}
    if "steps" in findings.cells:
        done = findings.cells[findings.cells["status"] == "done"]
        steps = done.groupby("group")["steps"].mean().to_dict()
    deep = [group for group in findings.best if _is_dqn(group)]
    return {
        "schema": 1,
        "sweep": findings.results.name,
        "use": 'stable_baselines3.DQN("MlpPolicy", env, **entry["kwargs"]).learn(entry["total_timesteps"])',
        "dqn": [_entry(group, steps.get(group.id)) for group in deep],
    }


def _is_dqn(group: Group) -> bool:
    """Return whether a group's agent is deep and has all hyperparameters of DQN; a custom one may lack some."""
    return agent_named(group.agent).kind == "deep" and DQN.model_fields.keys() <= group.hyperparameters.keys()


def _entry(group: Group, steps: float | None) -> dict[str, Any]:
    return {
        **arm_entry(group),
        "kwargs": _arguments(group.hyperparameters, steps),
        "total_timesteps": round(steps) if steps is not None else None,
        "without_counterpart": _lost(group.hyperparameters),
    }


def _arguments(values: Mapping[str, Any], steps: float | None) -> dict[str, Any]:
    arguments = {theirs: values[ours] for ours, theirs in SAME.items()}
    arguments |= {"learning_starts": values["batch_size"] - 1, "train_freq": 1, "gradient_steps": 1, "tau": 1.0}
    arguments["exploration_fraction"] = _exploration_fraction(values, steps)
    arguments["policy_kwargs"] = {"net_arch": [values["hidden_size"]] * values["hidden_layers"]}
    bootstrap = values["truncation"] == "bootstrap"
    return arguments | {"replay_buffer_kwargs": {"handle_timeout_termination": bootstrap}}


def _exploration_fraction(values: Mapping[str, Any], steps: float | None) -> float:
    """Return the share of training in which a linear epsilon has the mean of exp(-n / epsilon_decay); at most 1."""
    length = values["episodes"] if values["epsilon_unit"] == "episodes" else steps
    if not length:
        return 1.0
    decays = length / values["epsilon_decay"]
    return float(min(1.0, 2 * (1 - math.exp(-decays)) / decays))


def _lost(values: Mapping[str, Any]) -> dict[str, str]:
    """Return each hyperparameter that DQN's arguments cannot express, with what happens instead."""
    lost = dict(ELSEWHERE)
    if values["loss"] == "squared":
        lost["loss"] = "squared here; stable-baselines3 always has the Huber loss"
    if values["double"]:
        lost["double"] = "double DQN here; stable-baselines3 has plain DQN alone"
    if values["module"]:
        lost["module"] = f"{values['module']} here; a feature extractor has to be written for stable-baselines3"
    return lost | {name: ADVICE for name in values if name not in DQN.model_fields}
