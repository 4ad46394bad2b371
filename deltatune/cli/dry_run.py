"""The output of `deltatune sweep --dry-run`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

from deltatune.cli.app import err, out, print_json, print_named
from deltatune.cli.sheet import table
from deltatune.cli.tables import duration, span
from orchestrator.cluster.resources import local_cpus
from orchestrator.execution.forecast import Stage, forecast
from orchestrator.execution.settings import Settings, origins
from orchestrator.results.sweep_folder import Results
from search_spaces.search_space import SearchSpace
from trainables.plugins.names import short


def _cells(stage: Stage) -> str:
    """Return the number of cells; where a sequential test decides, the least and the most."""
    return str(stage.cells) if stage.most == stage.cells else f"{stage.cells} to {stage.most}"


def print_forecast(space: SearchSpace, settings: Settings, folder: Path, as_json: bool) -> None:
    """Print what a sweep with these settings would run and cost. Writes nothing."""
    with err.status("measuring"):
        found = forecast(space, settings, Results(folder), settings.workers or local_cpus())
    low, high = found.wall
    if as_json:
        print_json(asdict(found) | {"seconds": [low, high]})
        return
    stages = [(s.stage, _cells(s), str(s.done), span(s.low, s.high) if s.high else "-") for s in found.stages]
    out.print(table(("stage", "cells", "already done", "the rest, on one core"), stages))
    for stage in found.stages:
        if stage.taken:
            out.print(f"{stage.stage}: {origins(stage.taken)}", soft_wrap=True)
        for sentence in stage.longer.sentences():
            out.print(f"{stage.stage}: {sentence}", soft_wrap=True)
    if found.costs:
        costs = [(short(c.task), short(c.agent), span(c.low, c.high), c.origin) for c in found.costs]
        out.print(table(("task", "agent", "an episode", "estimated from"), costs))
    for why in found.unknown:
        print_named("Unknown cost", why, "yellow")
    ends = f"{duration(found.start + found.publish)} of it to start and to publish"
    text = f"about {span(low, high)} on {found.workers} workers, {ends}" if found.start else "nothing is left to run"
    out.print(f"In total: {text}. Nothing was written.", soft_wrap=True)
