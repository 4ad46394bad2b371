"""The head of the report: how the sweep was run, and its main results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from dashboards.labels import SOURCES, count, label, listed, minus
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.analysis.metrics import DIFFERENCE, TRANSFER_RATIO
from search_spaces.search_space import SearchSpace

STATUSES = ("done", "failed", "missing", "stopped")
CHANGES = "+changes"
"""The suffix of a commit whose working tree had uncommitted changes."""


@dataclass(frozen=True)
class Summary:
    """How often transfer helped or hurt, and the best configuration on each target."""

    helped: int
    hurt: int
    undecided: int
    lines: tuple[tuple[str, str, str], ...]
    """(target, agent, sentence) of the best on each target."""


def stamp(findings: Findings) -> list[tuple[str, str]]:
    """Return (term, value) pairs on the origin of the results: commit, versions, seeds, budget."""
    meta, space = findings.results.meta(), findings.results.space()
    commit, dirty = str(meta["commit"]).removesuffix(CHANGES), str(meta["commit"]).endswith(CHANGES)
    created = datetime.fromtimestamp(meta["created"], UTC).strftime("%Y-%m-%d %H:%M UTC")
    cells = findings.each_cell
    counts = Counter(cells["status"]) if len(cells) else Counter()
    hours = float(cells["seconds"].sum()) / 3600 if "seconds" in cells else 0.0
    shown = [name for name in STATUSES if name != "stopped" or counts[name]]
    return [
        ("sweep", findings.results.name),
        ("search space", space.name),
        ("begun", created),
        ("commit", commit + (", with uncommitted changes" if dirty else ", clean" if commit != "unknown" else "")),
        ("versions", ", ".join(f"{name} {version}" for name, version in meta["versions"].items())),
        ("seeds", f"{len(space.seeds)} ({_seeds(space.seeds)})"),
        ("budget", _budget(findings, space, hours)),
        ("cells", ", ".join(f"{counts[name]} {name}" for name in shown)),
    ]


def _seeds(seeds: Sequence[int]) -> str:
    run = len(seeds) > 2 and list(seeds) == list(range(seeds[0], seeds[0] + len(seeds)))
    return f"{seeds[0]} to {seeds[-1]}" if run else ", ".join(map(str, seeds))


def _budget(findings: Findings, space: SearchSpace, hours: float) -> str:
    episodes = sorted({int(g.hyperparameters["episodes"]) for g in findings.groups if "episodes" in g.hyperparameters})
    search = "every value of the grids" if space.search.method == "grid" else f"{space.search.method} search"
    search += "" if space.search.method == "grid" else f", {count(space.search.budget, 'configuration')} each"
    trained = f"{hours:.2f} core-hours" if hours >= 0.1 else f"{hours * 60:.1f} core-minutes"
    counted = f"{listed([f'{n:,}' for n in episodes])} episodes a cell; " if episodes else ""
    return f"{counted}{search}; {trained} of training"


def summary(findings: Findings, winners: Sequence[Group]) -> Summary:
    """Return how often transfer helped, and a sentence on the best configuration of each target."""
    verdicts = Counter(group.verdict for group in findings.best)
    lines = tuple((group.task, group.agent, _sentence(group, findings.common)) for group in winners)
    return Summary(verdicts["helped"], verdicts["hurt"], verdicts["undecided"], lines)


def _sentence(group: Group, hide: Collection[str]) -> str:
    source = f", {SOURCES[group.source]}" if group.source in SOURCES else ""
    name = label(group, hide)
    text = f"{name}{source}: AUC {group.auc.value:.2f}" if group.auc else name
    if group.against_base is None:
        return minus(text) + "; no transfer did better"
    gap, ratio = group.against_base.difference, group.against_base.transfer_ratio
    text += f", {DIFFERENCE.text(gap)}"
    text += "" if ratio.value is None else f" ({TRANSFER_RATIO.text(ratio)})"
    return minus(text) + " against no transfer"
