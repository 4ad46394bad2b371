"""The origin of the results: the sweep, its code, its seeds and its budget."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime

from dashboards.labels import count, listed
from dashboards.report.verdict import STATUSES
from orchestrator.analysis.findings import Findings
from search_spaces.search_space import SearchSpace

CHANGES = "+changes"
"""The suffix of a commit whose working tree had uncommitted changes."""


def origin(findings: Findings) -> list[tuple[str, str]]:
    """Return (term, value) pairs in display order."""
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
        ("seeds", _count(space)),
        ("budget", _budget(findings, space, hours)),
        ("cells", ", ".join(f"{counts[name]} {name}" for name in shown)),
    ]


def _count(space: SearchSpace) -> str:
    test = space.sequential
    least = f"{test.group} to " if test else ""
    how = f", by a sequential test with family-wise error {test.alpha:g}" if test else ""
    return f"{least}{len(space.seeds)} ({_seeds(space.seeds)}){how}"


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
