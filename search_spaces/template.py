"""The commented search space that `deltatune init` writes for a task."""

from __future__ import annotations

import re

from trainables.agents.agent import Agent
from trainables.agents.registry import AGENTS
from trainables.errors import InputError
from trainables.tasks.registry import parse_task
from trainables.tasks.spec.family import Task

KEPT = ("levels", "limit")
"""Features that source and target must share, since they change actions or episode length."""

QUICK = 10
"""With --quick, the episodes are divided by this."""

TEMPLATE = """\
# What to sweep, written by 'deltatune init {typed}'. It runs as it is; every line may be changed.
#   deltatune sweep {file} --dry-run   shows what it would run, and the cost
#   deltatune sweep {file}   runs it; the same command again continues
schema: 1
name: {name}  # the folder of its results
description: Does knowledge of {source} help or hurt on other versions of it?
seeds: {seeds}
scenarios:
  - source:  # stage 1: trained first
      task: {source}
      agent: {base}  # any agent that learns without a source
      {kinds}
      hyperparameters:  # stage 2 uses the best of these by mean AUC
        learning_rate: {rates}
    targets:  # stage 2: every agent below learns each of these; 2x is twice the default
{targets}
      # features: {features}
hyperparameters:  # for every agent that has them; 'deltatune agents NAME' explains them
  episodes: {episodes}
  evaluate_every: {every}
agents:  # for each hyperparameter one value, a list of values to try, or a range with 'search'
{agents}
# A range:  {range}  together with
# search: {{method: random, budget: 20}}      # or method: optuna
# Scores of several tasks on one scale, 0 for a random policy and 1 for a solution:
# normalise: {{"{source}": [RANDOM_RETURN, SOLVED_RETURN]}}
"""


def starter(typed: str, name: str, file: str, quick: bool = False) -> str:
    """Return the YAML of a search space for the task called `name`, which the user typed as `typed`.

    Its features make the target where they differ from their defaults, else the targets are those of the family.
    quick: one learning rate, few seeds, and 1 / QUICK of the episodes.
    """
    task = parse_task(name)
    source = Task(task.family, tuple(change for change in task.changed if change[0] in KEPT))
    called = typed if not task.changed else typed.removesuffix(_features(typed))
    spelled = called + (f":{_text(source)}" if source.changed else "")
    targets = [f"{called}:{text}" for text in _targets(task, source)] or [spelled]
    agents = [agent for agent in AGENTS.values() if agent.usual and (agent.kind == "tabular") == task.tabular]
    base = next(agent for agent in agents if not agent.needs_source)
    settings = base.resolve(task, {}).model_dump()
    episodes = max(20, settings["episodes"] // QUICK) if quick else settings["episodes"]
    return TEMPLATE.format(
        typed=typed,
        file=file,
        name=_slug(called),
        source=spelled,
        base=base.name,
        kinds="kinds: [learned, exact]  # trained by the agent above; by value iteration"
        if task.tabular
        else "pick: best_evaluated  # the best network of all seeds; or own_seed",
        seeds="2  # a quick look; 5 or more for results" if quick else "5  # 0 to 4; more seeds, narrower intervals",
        rates=("[0.5]" if quick else "[0.5, 0.1]") if task.tabular else "[1.0e-3]" if quick else "[1.0e-3, 1.0e-4]",
        targets="\n".join(f"      - {target}" for target in targets),
        features=", ".join(feature.name for feature in task.family.features) or "none",
        episodes=f"{episodes}  # a quick look; {settings['episodes']} for results" if quick else episodes,
        every=min(settings["evaluate_every"], max(1, episodes // 10)),
        range="delta_gate: {threshold: {low: 1, high: 20}}"
        if task.tabular
        else "delta_es: {advice_fraction: {low: 0.1, high: 0.5}}",
        agents="\n".join(f"  {agent.name}: {{{_shown(agent, task)}}}" for agent in agents),
    )


def _shown(agent: Agent, task: Task) -> str:
    """Return an agent's most important hyperparameters with their values on the task."""
    values = agent.resolve(task, {}).model_dump()
    return ", ".join(f"{name}: {values[name]}" for name in agent.shown)


def _features(typed: str) -> str:
    """Return the features in a name as text, with the colon before them."""
    match = re.search(r":[A-Za-z_][\w.]*=.*$", typed)
    return match.group() if match else ""


def _text(task: Task) -> str:
    return ",".join(f"{name}={task.family.feature(name).text(value)}" for name, value in task.changed)


def _targets(task: Task, source: Task) -> list[str]:
    """Return the features of each target, as text."""
    if task.changed != source.changed:
        return [_text(task)]
    prefix = f"{_text(source)}," if source.changed else ""
    if task.family.targets:
        return [prefix + target.removeprefix(f"{task.family.name}:") for target in task.family.targets]
    for feature in task.family.features:
        if feature.name in KEPT:
            continue
        for text in (*feature.named, "1.5x", "0.5x"):
            try:
                value = feature.value(text)
            except InputError:
                continue
            if value != feature.default:
                return [f"{prefix}{feature.name}={text}"]
    return []


def _slug(text: str) -> str:
    """Return a name for the sweep."""
    text = re.sub(r"\.py(:Task$|:)|^gym:", "-", text.rpartition("/")[2] if ".py" in text else text)
    return re.sub(r"[^A-Za-z0-9]+", "-", text).strip("-").lower()[:64] or "mine"
