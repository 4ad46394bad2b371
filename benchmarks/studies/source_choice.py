"""Evaluates the sources that `deltatune rank` recommends.

`python -m benchmarks.studies.source_choice gridworld | cartpole [--storage results/choice]` prints Markdown: the regret
of the recommended source (return lost against the best of the library) compared with that of a random pick, of trying
each source equally often, and of three simpler scores of delta on the same episodes. Sources are trained once and kept.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from orchestrator.analysis import statistics
from orchestrator.execution.cells.ledger import record_of
from orchestrator.sources.library import Entry, SourceLibrary
from trainables.cell import Cell
from trainables.delta.exact import exact_q, policy_q
from trainables.delta.sample import delta_sample
from trainables.evaluation import expected_return
from trainables.knowledge import Knowledge
from trainables.learners.greedy_evaluation import greedy_returns
from trainables.numerics.rng import stream
from trainables.numerics.threads import one_thread
from trainables.source_ranking.path_value import Follower
from trainables.source_ranking.ranking import Ranking, SourceComparison, rank
from trainables.source_ranking.tabular import Player, TabularComparison
from trainables.tasks.make import make_env
from trainables.tasks.registry import parse_task
from trainables.training.cell_run import run_cell

GAMMA = 0.99
SOURCES, DRAWS, EPISODES = 30, 20, 100
FIRST_DRAW = 20
"""Draws 0 to 19 were used to choose the settings of the ranking."""
GRAVITIES = (2, 5, 9.8, 15, 20, 30, 40, 50, 60, 70, 85, 100)
"""In m/s^2; 9.8 is CartPole's default, the paper's targets have 49 and 68.6."""
JUDGED = 200
"""Greedy episodes for the true return of a network on a target."""
NONE_SIZES = (1, 2, 3, 5)
"""Library sizes at which the recommendation of no source is evaluated."""


def trained(library: SourceLibrary, agent: str, task: str) -> Entry:
    """Return the source of seed 0 with default settings, trained now unless the library has it."""
    cell = Cell.create(agent, task, 0)
    if not library.has(cell.id):
        outcome = run_cell(cell, lambda cell: None, keep=True)
        assert outcome is not None
        assert outcome.knowledge is not None
        library.save(cell, Knowledge.from_bytes(outcome.knowledge)[0], record_of(outcome))
    return library.entry(cell.id)


def wind(number: int) -> str:
    """Return a gridworld with a random wind."""
    return f"windy_gridworld:wind=random-{number}"


class Regrets:
    """Regrets of several ways to choose, over draws."""

    def __init__(self) -> None:
        self.of: dict[str, list[float]] = defaultdict(list)

    def add(self, name: str, returns: np.ndarray, chosen: int | None = None) -> None:
        """Add the regret of `chosen`; without one, of a random pick."""
        self.of[name].append(float(returns.max() - (returns.mean() if chosen is None else returns[chosen])))

    def table(self, title: str) -> str:
        """Return a Markdown table: mean with its interval, and the largest."""
        lines = [f"\n{title}\n", "|choice|regret, mean [95%]|largest|", "|---|---|---|"]
        for name, values in self.of.items():
            mean = statistics.mean(values)
            lines.append(f"|{name}|{mean.value:.1f} [{mean.low or 0:.1f}, {mean.high or 0:.1f}]|{max(values):.1f}|")
        return "\n".join(lines)


def _simple_scores(target: str, tables: Sequence[np.ndarray], seed: int) -> dict[str, int]:
    """Return the choices from equally many episodes of each source: by returns, and by simpler scores of delta."""
    player = Player(target, seed)
    followers = [Follower(q, player.start, GAMMA) for q in tables]
    returns: dict[int, list[float]] = defaultdict(list)
    for episode in range(EPISODES):
        k = episode % len(tables)
        returns[k].append(player.play(followers[k].pi, GAMMA))
    seen = player.seen
    means, largest, path = [], [], []
    for q, follower in zip(tables, followers, strict=True):
        v = np.append(q.max(axis=1), 0.0)
        base = seen.reward + seen.times * delta_sample(0.0, GAMMA, v[seen.next_state], q[seen.state, seen.action])
        pair = seen.state * q.shape[1] + seen.action
        n = np.maximum(np.bincount(pair, seen.times, q.size), 1e-9)
        size = np.abs(np.bincount(pair, base, q.size) / n)
        means.append(float(n @ size / n.sum()))
        largest.append(float(size[n >= 5].max()))
        path.append(follower.estimate(seen).value)
    return {
        "each source equally often, best mean return": int(
            np.argmax([np.mean(returns[k]) for k in range(len(tables))])
        ),
        "the same episodes, smallest mean abs delta": int(np.argmin(means)),
        "the same episodes, smallest largest abs delta": int(np.argmin(largest)),
        "the same episodes, largest promise + path delta": int(np.argmax(path)),
    }


def gridworld(library: SourceLibrary) -> None:
    """Evaluate 20 draws of 30 sources and a target with random winds, with exact and learned sources."""
    for kind in ("exact", "learned"):
        regrets, covered = Regrets(), []
        advice: dict[int, list[tuple[bool, float, float]]] = defaultdict(list)
        for draw in range(FIRST_DRAW, FIRST_DRAW + DRAWS):
            names = [wind(1000 * (draw + 1) + number) for number in range(SOURCES + 1)]
            target, tasks = names[0], [parse_task(name).name for name in names[1:]]
            tables = [
                exact_q(task, GAMMA) if kind == "exact" else trained(library, "q_learning", task).knowledge.arrays["q"]
                for task in tasks
            ]
            model = parse_task(target).model()
            returns = np.array([expected_return(model, q.argmax(axis=1), GAMMA)[0] for q in tables])
            ranking = _ranked(target, tasks, tables, draw)
            best = ranking.ranked[0]
            regrets.add("deltatune rank", returns, best.source)
            regrets.add("random pick", returns)
            for name, chosen in _simple_scores(target, tables, draw).items():
                regrets.add(name, returns, chosen)
            policy = tables[best.source].argmax(axis=1)
            truth = policy_q(model, policy, GAMMA)[model.start, policy[model.start]]
            covered.append(best.low <= truth <= best.high)
            scratch = trained(library, "q_learning", target).record
            assert scratch is not None
            without = float(np.mean(scratch.returns))
            for size in NONE_SIZES:
                few = _ranked(target, tasks[:size], tables[:size], draw)
                top = returns[:size].max()
                advice[size].append(
                    (few.recommended is not None, returns[few.ranked[0].source] - without, top - without)
                )
        print(regrets.table(f"Gridworld, {kind} sources: {DRAWS} draws of {SOURCES}, {EPISODES} episodes"))
        print(f"\n95% interval of the chosen source's return covers the truth in {sum(covered)} of {DRAWS} draws.\n")
        print("|library|recommended: helps / hurts|none: right / wrong|\n|---|---|---|")
        for size, cases in advice.items():
            yes = [gain for recommended, gain, _ in cases if recommended]
            no = [top for recommended, _, top in cases if not recommended]
            right, wrong = sum(top <= 0 for top in no), sum(top > 0 for top in no)
            print(f"|{size} sources|{sum(g > 0 for g in yes)} / {sum(g <= 0 for g in yes)}|{right} / {wrong}|")


def _ranked(target: str, tasks: Sequence[str], tables: Sequence[np.ndarray], seed: int) -> Ranking:
    comparison: SourceComparison = TabularComparison(target, list(zip(tasks, tables, strict=True)), GAMMA, seed)
    return rank(comparison, len(tables), EPISODES)


def cartpole(library: SourceLibrary) -> None:
    """Evaluate each of 12 gravities as the target of the networks of the 11 others."""
    from orchestrator.sources.ranking import rank_sources
    from trainables.networks.network import source_network
    from trainables.tasks.shape import task_shape
    from trainables.tasks.step_env import Environment

    tasks = [parse_task(f"cartpole:gravity={gravity}").name for gravity in GRAVITIES]
    entries = {task: trained(library, "dqn", task) for task in tasks}
    for episodes in (50, EPISODES):
        regrets, lines = Regrets(), []
        for target in tasks:
            others = sorted((entry for task, entry in entries.items() if task != target), key=lambda entry: entry.id)
            envs = [Environment(make_env(parse_task(target))) for _ in range(JUDGED)]
            seeds = stream(0, "evaluation_env", target).integers(2**31, size=JUDGED).tolist()
            returns = []
            for entry in others:
                settings: Any = entry.cell.settings
                network = source_network(entry.knowledge, "best", settings, *task_shape(parse_task(target)))
                returns.append(greedy_returns(envs, seeds, network.rows, GAMMA)[0].mean())
            found = rank_sources(target, others, episodes, 0)
            best, true = found.ranking.ranked[0], np.array(returns)
            regrets.add("deltatune rank", true, best.source)
            regrets.add("random pick", true)
            sizes = [(each.target.delta, each.source) for each in found.ranking.ranked]
            regrets.add("smallest root mean square delta, same episodes", true, min(sizes)[1])
            chosen = found.entries[best.source].cell.task
            lines.append(
                f"|{target}|{chosen}|{true[best.source]:.1f}|{true.max():.1f}|{true.mean():.1f}|{best.verdict}|"
            )
        print(regrets.table(f"CartPole, {len(tasks)} gravities, {episodes} episodes on each target"))
    print("\n|target|chosen|its return|best of 11|mean of 11|verdict|\n|---|---|---|---|---|---|\n" + "\n".join(lines))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("gridworld", "cartpole"))
    parser.add_argument("--storage", type=Path, default=Path("results/choice"))
    arguments = parser.parse_args()
    one_thread()
    {"gridworld": gridworld, "cartpole": cartpole}[arguments.what](SourceLibrary(arguments.storage))


if __name__ == "__main__":
    main()
