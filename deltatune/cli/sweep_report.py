"""The output of `deltatune sweep` at its end."""

from __future__ import annotations

import time
from dataclasses import asdict
from typing import Any, NoReturn

import typer

from dashboards.renderers.drawing_process import DrawingProcess
from deltatune.cli.app import err, out, print_json, print_named, program
from deltatune.cli.tables import confirmed_table, contrast_table, decision_table, group_table
from deltatune.publish import Publication, Published
from orchestrator.analysis.contrasts.decisions import numbers
from orchestrator.analysis.contrasts.table import caption
from orchestrator.analysis.findings import Findings
from orchestrator.analysis.selection import optimism
from orchestrator.execution.session import SweepSession
from orchestrator.execution.settings import RunSummary, origins
from orchestrator.export.best_params import best
from orchestrator.results.sweep_folder import Results
from orchestrator.tracking.tracker import Tracker
from orchestrator.tracking.trackers import without_registry
from orchestrator.tracking.uri import shown
from trainables.agents.registry import agent_named


def report(session: SweepSession, tally: RunSummary, as_json: bool, artist: DrawingProcess) -> None:
    """Publish a finished sweep, and print its best configurations and where its files are. artist: draws figures."""
    started, results, tracker = time.monotonic(), session.results, session.tracker
    console = err if as_json else out
    with console.status("tables, figures and MLflow"):
        publication = Publication(results, artist)
        sources = session.finish(publication.findings, publication.artifacts())
        published = publication.published()
    after = time.monotonic() - started
    if as_json:
        print_json(_summary(results, tally, published, tracker, after) | {"sources": sources})
    else:
        _print_report(results, tally, published, tracker, after)
        for source in sources:
            out.print(f"Source:   {source}", soft_wrap=True)
    for why in published.missing:
        err.print(f"not drawn: {why}", soft_wrap=True, style="yellow")
    if tally.failed:
        raise typer.Exit(1)


def interrupted(session: SweepSession, tally: RunSummary, as_json: bool) -> NoReturn:
    """Print what an interrupted sweep has done, and exit with code 130."""
    if as_json:
        print_json({"sweep": str(session.results.folder), "tally": asdict(tally), "interrupted": True})
    else:
        ended = f"{tally.ran} cells run ({tally.failed} failed), {tally.reused} reused"
        out.print(f"{ended}, {tally.left} left; long ones are checkpointed.", soft_wrap=True)
    err.print("interrupted: the same command continues from here", soft_wrap=True)
    raise typer.Exit(130)


def _summary(
    results: Results, tally: RunSummary, published: Published, tracker: Tracker | None, after: float
) -> dict[str, Any]:
    return {
        "sweep": str(results.folder),
        "tally": asdict(tally) | {"publishing_seconds": after},
        "best": best(published.findings),
        "decisions": [numbers(each) for each in published.findings.decisions],
        "report": str(published.report) if published.report else None,
        "not_drawn": published.missing,
        "figures": [str(path) for path in published.figures],
        "mlflow": None,
    } | ({tracker.kind.key: _tracked(tracker)} if tracker else {})


def print_contrasts(findings: Findings) -> None:
    """Print each agent's difference from those that it builds on; that from its base is in the table of the best."""
    shown = [each for each in findings.contrasts if agent_named(each.first.agent).base != each.second.agent]
    if shown:
        out.print(contrast_table(shown, caption(shown)))


def print_decisions(findings: Findings) -> None:
    """Print the decisions of a sequential test over seeds, if the sweep has one."""
    if findings.decisions:
        out.print(decision_table(findings.decisions, findings.results.space()))


def _tracked(tracker: Tracker) -> dict[str, Any]:
    return {"uri": shown(tracker.uri), "error": str(tracker.error) if tracker.error else None}


def _overhead(tally: RunSummary, total: float) -> str:
    """Return the share of `total` seconds in which no worker trained; empty where cells began in an earlier run."""
    share = 100 * (1 - tally.training_seconds / (tally.workers * total)) if tally.workers else 100
    return f", {share:.0f} % of it overhead" if share >= 0 else ""


def _print_report(
    results: Results, tally: RunSummary, published: Published, tracker: Tracker | None, after: float
) -> None:
    _print_tables(published.findings)
    total = tally.seconds + after
    stopped = f", {tally.stopped} stopped early" if tally.stopped else ""
    stopped += f", {tally.continued} continued from shorter ones" if tally.continued else ""
    taken = f" ({origins(tally.taken)})" if tally.taken else ""
    out.print(
        f"{tally.ran} cells run ({tally.failed} failed{stopped}), {tally.reused} reused{taken}; {total:.0f} s"
        f"{_overhead(tally, total)}."
    )
    out.print(f"Results:  {results.folder}", soft_wrap=True)
    if published.report:
        out.print(f"Report:   {published.report}", soft_wrap=True)
    for path in (path for path in published.figures if path.suffix == ".png"):
        out.print(f"Figure:   {path}", soft_wrap=True)
    if published.best:
        out.print(f"Best:     {published.best}", soft_wrap=True)
    if tracker:
        _print_copy(results, tracker)


def _print_tables(findings: Findings) -> None:
    """Print the best configurations, what their confirmation says, and those that are incomplete."""
    chosen = [selected.best for selected in findings.selected.values()]
    out.print(group_table(chosen, "Best configuration of each agent, by mean AUC over seeds"))
    if confirmed := [group for group in chosen if group.confirmed]:
        out.print(confirmed_table(confirmed))
    if said := optimism(chosen):
        out.print(said, soft_wrap=True, style="yellow")
    print_contrasts(findings)
    print_decisions(findings)
    if incomplete := [group for group in findings.groups if not group.complete]:
        out.print(group_table(incomplete, "Configurations with failed or missing seeds, never selected"))


def _print_copy(results: Results, tracker: Tracker) -> None:
    """Print where the tracker's copy is, or the command that completes it."""
    sync = f"{program()} sync {results.name} --storage {results.storage}"
    if tracker.error:
        print_named(
            "MLflow is incomplete" if tracker.kind.has_registry else f"{tracker.uri} is incomplete",
            f"{tracker.error}. The results are complete; once it is reachable again:",
            "yellow",
        )
        where = "" if tracker.kind.has_registry else f" --tracking-uri {tracker.uri}"
        out.print(f"          {sync}{where}", soft_wrap=True)
    elif said := without_registry(tracker.uri):
        out.print(f"Copy:     {tracker.parent}", soft_wrap=True)
        out.print(f"          {said}: {sync}", soft_wrap=True)
    else:
        out.print(f"MLflow:   {program()} ui --storage {results.storage}", soft_wrap=True)
