"""Hyperparameter importance: how much of the variance of the AUC over the searched ranges each hyperparameter explains.

The estimate is Optuna's fANOVA (Hutter et al., ICML 2014): a random forest is fitted to the mean AUCs of an arm's
configurations, and the variance of its prediction is split among the hyperparameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.planning.arms import Key
from search_spaces.domains import Range
from search_spaces.search_space import SearchSpace

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution

MIN_CONFIGURATIONS = 10
"""With fewer finished configurations an arm has no estimate: a forest of so few points says little."""


@dataclass(frozen=True)
class Importance:
    """The importance of each hyperparameter of one arm."""

    key: Key
    source_label: str
    configurations: int
    shares: Mapping[str, float]
    """Hyperparameter to its share of the explained variance, largest first; they sum to 1."""


def importances(findings: Findings) -> list[Importance]:
    """Return the importance for each arm with ranges and at least MIN_CONFIGURATIONS complete configurations.

    Two hyperparameters must vary: the share of a single one is 1, whatever it does.
    """
    arms: dict[Key, list[Group]] = {}
    for group in findings.groups:
        if group.complete and group.auc:
            arms.setdefault(group.key, []).append(group)
    space = findings.results.space()
    found = []
    for key, groups in arms.items():
        if len(groups) < MIN_CONFIGURATIONS or not (searched := ranges(space, groups[0])):
            continue
        if len(space_of_arm := _distributions(groups, searched)) > 1:
            shares = _fanova(groups, space_of_arm)
            if shares is not None:
                found.append(Importance(key, groups[0].source_label, len(groups), shares))
    return found


def ranges(space: SearchSpace, group: Group) -> dict[str, Range]:
    """Return the ranges from which the hyperparameters of a group were drawn, by name."""
    options = {**space.hyperparameters, **space.agents.get(group.agent, {})}
    if group.stage == "source":
        for scenario in space.scenarios:
            options |= scenario.source.hyperparameters if scenario.source.agent == group.agent else {}
    return {name: option for name, option in options.items() if isinstance(option, Range)}


def _distributions(groups: Sequence[Group], searched: Mapping[str, Range]) -> dict[str, BaseDistribution]:
    """Return what varies among configurations as distributions; none where no range is among it."""
    from optuna.distributions import CategoricalDistribution

    from orchestrator.planning.search import distribution

    found: dict[str, BaseDistribution] = {}
    for name in groups[0].hyperparameters:
        values = list(dict.fromkeys(group.hyperparameters[name] for group in groups))
        if len(values) > 1:
            found[name] = distribution(searched[name]) if name in searched else CategoricalDistribution(values)
    return found if searched.keys() & found.keys() else {}


def _fanova(groups: Sequence[Group], space: Mapping[str, BaseDistribution]) -> dict[str, float] | None:
    """Return the shares, largest first, or None where every configuration has the same AUC."""
    import optuna

    aucs = [group.auc.value for group in groups if group.auc]
    if max(aucs) - min(aucs) < 1e-9:
        return None
    study = optuna.create_study(direction="maximize")
    for group, auc in zip(groups, aucs, strict=True):
        params = {name: _within(group.hyperparameters[name], space[name]) for name in space}
        study.add_trial(optuna.trial.create_trial(params=params, distributions=dict(space), value=auc))
    evaluator = optuna.importance.FanovaImportanceEvaluator(seed=0)
    return dict(optuna.importance.get_param_importances(study, evaluator=evaluator))


def _within(value: Any, option: Any) -> Any:
    """Return the value, or the end of its range if rounding to 12 digits has put it outside."""
    return min(max(value, option.low), option.high) if hasattr(option, "low") else value
