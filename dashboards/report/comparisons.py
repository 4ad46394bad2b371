"""The sections of the report that compare agents: contrasts, over all tasks, between source networks and seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dashboards.figure_model import Absent, Figure
from dashboards.figures import over_tasks as figure
from dashboards.labels import count, minus
from dashboards.report.tables import Datum, Table, datum, mark, records, text_csv
from orchestrator.analysis.contrasts import decisions as sequential
from orchestrator.analysis.contrasts.contrast import Contrast
from orchestrator.analysis.contrasts.table import comparisons, row
from orchestrator.analysis.contrasts.table import numbers as numbers_of
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.groups import Group
from orchestrator.analysis.metrics import DIFFERENCE, EARLY_DIFFERENCE, METRICS, Metric, signed
from orchestrator.analysis.over_tasks import OverTasks, Standing
from orchestrator.analysis.over_tasks import number_table as standings_of
from trainables.plugins.names import short

SHARES = {metric.key: metric for metric in METRICS if "variance" in metric.key}
"""The shares of variance."""

MAX_PAIRS = 300
"""Pairs of agents on targets of which the report has every one; `deltatune contrast --all` has them always."""

LEAD = (
    "The difference A − B in AUC between two agents on the same target with the same source, paired by seed. Among "
    "many comparisons some come out by chance alone: Holm's p-values are corrected for all of the table, its wider "
    "intervals cover all at once, and a verdict that the correction takes back says so."
)


def contrasts(findings: Findings) -> tuple[Table | Figure, ...]:
    """Return the sweep's family of contrasts, and every pair of agents where there are more."""
    if not findings.contrasts:
        reason = "No two agents have every seed done on the same target."
        return (Absent("contrasts", "Contrasts", reason),)
    shown = findings.contrasts
    tables = [contrast_table(shown, "contrasts", f"{_counted(shown)}: each agent against what it builds on")]
    agents, tasks = {group.agent for group in findings.best}, {group.task for group in findings.best}
    few = len(agents) * (len(agents) - 1) // 2 * len(tasks) <= MAX_PAIRS
    if few and len(every := findings.contrast(every=True)) > len(shown):
        tables.append(contrast_table(every, "pairs", f"{_counted(every)}: every pair of agents", folded=True))
    return tuple(tables)


def decisions(findings: Findings) -> tuple[Table | Figure, ...]:
    """Return what a sequential test over seeds has decided; nothing where the seeds are fixed."""
    found = findings.decisions
    if not found:
        return ()
    symbols = {"better": "helped", "worse": "hurt"}
    columns = tuple((name, name in ("A - B", "seeds")) for name in sequential.COLUMNS)
    rows = []
    for each, texts in zip(found, sequential.rows(found), strict=True):
        data = [Datum(minus(text), text) for text in texts]
        data[0] = Datum(each.task, each.task)
        data[4], data[5] = Datum(minus(texts[4]), each.difference), Datum(texts[5], each.seeds)
        data[6] = Datum(texts[6], texts[6], mark=symbols.get(each.outcome.state, ""))
        rows.append(tuple(data))
    records = [sequential.numbers(each) for each in found]
    caption = sequential.caption(found, findings.results.space())
    return (Table("decisions", caption, columns, tuple(rows), text_csv(records)),)


def over_tasks(findings: Findings, of: dict[str, Figure]) -> tuple[Table | Figure, ...]:
    """Return the table and the figures of normalised scores over all tasks."""
    means, profile = of[figure.NAME], of[figure.PROFILE]
    if isinstance(means, Absent) and isinstance(profile, Absent) and means.reason == profile.reason:
        return (replace(means, title="Over all tasks"),)
    found = findings.over_tasks
    caption = f"Normalised AUC over {count(len(found.tasks), 'task')}"
    return standings_table(found, "over-tasks", caption), means, profile


def variance(findings: Findings) -> tuple[str, tuple[Table | Figure, ...]]:
    """Return the lead and the table of how much the source network decides."""
    crossed = [group for group in findings.best if group.estimate("variance_sources")]
    if not crossed:
        return "", (Absent("variance", "Variance", _one_source(findings)),)
    most = max(crossed, key=lambda group: group.estimates["variance_sources"].value or 0.0)
    parts = [SHARES[name].text(most.estimates.get(name)) for name in ("variance_sources", "variance_seeds")]
    lead = f"Of the variance of the AUC of {short(most.agent)} on {short(most.task)}, {parts[0]} lies between its "
    lead += f"{most.sources} source networks, the largest share of all, and {parts[1]} between its {len(most.seeds)} "
    lead += (
        "seeds. Intervals of means and differences take both for random: a result with one source network is one draw."
    )
    caption = "Shares of the variance of one run, by analysis of variance with generalised 95 % intervals"
    return lead, (variance_table(crossed, "shares", caption),)


def _one_source(findings: Findings) -> str:
    learned = [group for group in findings.best if group.source == "learned"]
    if any(group.sources == 1 and len(group.seeds) > 1 for group in learned):
        return (
            "All seeds of an agent learned from one source network, so its intervals say nothing of another one, and a "
            "result is one draw of it. Several source networks crossed with the seeds would tell (source.pick: each)."
        )
    if learned:
        return (
            "Each seed learned from a source network of its own, so that intervals cover both; which of the two "
            "matters more, only source networks crossed with seeds would tell (source.pick: each)."
        )
    return "No agent with a learned source has every seed done."


def _counted(found: Sequence[Contrast]) -> str:
    n = comparisons(found)
    return count(len(found), "contrast") + (f", corrected for {count(n, 'comparison')}" if n else "")


def contrast_table(found: Sequence[Contrast], name: str, caption: str, folded: bool = False) -> Table:
    """Paired differences between agents, each with its interval, alone and among all of them."""
    columns = [("task", False), ("A − B", False), ("source", False), ("seeds", True), (DIFFERENCE.heading, True)]
    columns += [
        ("all at once [95%]", True),
        ("p", True),
        ("p (Holm)", True),
        ("verdict", False),
        (EARLY_DIFFERENCE.heading, True),
    ]
    return Table(
        name,
        caption,
        tuple(columns),
        tuple(_contrast(each) for each in found),
        text_csv(list(map(numbers_of, found))),
        folded,
    )


def _contrast(contrast: Contrast) -> tuple[Datum, ...]:
    task, first, second, source, seeds, gap, p, p_holm, verdict, early = row(contrast)
    corrected, ends = contrast.corrected, "–"
    if corrected:
        ends = f"[{signed(corrected.low, DIFFERENCE.digits)}, {signed(corrected.high, DIFFERENCE.digits)}]"
    symbol = mark(contrast.verdict, corrected is not None and corrected.holds)
    return (
        Datum(task, contrast.first.task),
        Datum(f"{first} − {second}", contrast.name, agent=contrast.first.agent),
        Datum("–" if source == "none" else source, source),
        Datum(seeds, contrast.seeds),
        Datum(minus(gap), contrast.difference.value, mark=symbol),
        Datum(minus(ends), corrected.low if corrected else None),
        Datum(p, contrast.difference.p),
        Datum(p_holm, corrected.p if corrected else None),
        Datum(verdict, verdict),
        Datum(minus(early), contrast.early.value if contrast.early else None),
    )


def standings_table(found: OverTasks, name: str, caption: str) -> Table:
    """Aggregates of the normalised AUC of each agent, and its worst task."""
    shown = {"iqm": "IQM", "early_iqm": "early IQM", "median": "median", "optimality_gap": "gap to 1"}
    standings = sorted(found.standings, key=lambda standing: -standing.aggregates["iqm"].value)
    there = [key for key in shown if any(key in standing.aggregates for standing in standings)]
    columns = [("agent", False), ("source", False), ("runs", True), *((f"{shown[key]} [95%]", True) for key in there)]
    columns += [("worst difference [95%]", True), ("on", False)]
    rows = tuple(_standing(standing, there) for standing in standings)
    lines = [{str(key): value for key, value in line.items()} for line in standings_of(found).to_dict("records")]
    return Table(name, caption, tuple(columns), rows, text_csv(lines))


def _standing(standing: Standing, keys: Sequence[str]) -> tuple[Datum, ...]:
    entrant, runs = standing.entrant, sum(table.size for table in standing.scores)
    source = " from ".join(part for part in (entrant.source, entrant.source_task) if part)
    texts = [standing.aggregates.get(key) for key in keys]
    worst = standing.worst
    return (
        Datum(entrant.agent, entrant.agent, agent=entrant.agent),
        Datum("–" if entrant.source == "none" else source, source),
        Datum(str(runs), runs),
        *(Datum(minus(SCORE.text(each, missing="–")), each.value if each else None) for each in texts),
        Datum(minus(SCORE_DIFFERENCE.text(worst[1])) if worst else "–", worst[1].value if worst else None),
        Datum(worst[0] if worst else "–", worst[0] if worst else None),
    )


SCORE = Metric("score", "normalised AUC", lambda seeds: None, digits=3)
SCORE_DIFFERENCE = Metric("score_difference", "difference", lambda seeds: None, digits=3, signed=True)
"""How a normalised score and a difference of two are written."""


def variance_table(groups: Sequence[Group], name: str, caption: str) -> Table:
    """Groups of source networks crossed with seeds, with the shares of variance between either."""
    metrics = [metric for metric in METRICS if "variance" in metric.key]
    columns = [("task", False), ("agent", False), ("source", False), ("source networks", True), ("seeds", True)]
    columns += [(metric.heading, True) for metric in metrics]
    rows = tuple(
        (
            Datum(group.task, group.task),
            Datum(group.agent, group.agent, agent=group.agent),
            Datum(group.source_label, group.source_label),
            Datum(str(group.sources), group.sources),
            Datum(str(len(group.seeds)), len(group.seeds)),
            *(datum(metric, group) for metric in metrics),
        )
        for group in groups
    )
    return Table(name, caption, tuple(columns), rows, text_csv(records(groups)))
