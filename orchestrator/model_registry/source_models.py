"""Source models of a sweep: the trained cells that its transfers used, with their registry metadata."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass

from orchestrator.results.records.record import Record
from orchestrator.results.sweep_folder import Results
from orchestrator.sources.library import SourceLibrary
from trainables.cell import Cell, content_id
from trainables.curve import auc
from trainables.knowledge import Knowledge
from trainables.tasks.registry import parse_task

MAX_CHARACTERS = 200
"""Of a registered model's name."""


@dataclass(frozen=True)
class SourceModel:
    """A trained source that a sweep's transfers have used."""

    cell: Cell
    knowledge: Knowledge
    record: Record
    steps: Mapping[int, int]
    """Seed to T, the training steps of that seed's source run with these hyperparameters (eq. 6)."""

    def tags(self, sweep: str) -> dict[str, str]:
        """Return the tags of the model's version; `steps` and `hyperparameters` are JSON."""
        from orchestrator.analysis.curves.learning import learned_nothing  # imports pandas and scipy

        nothing = learned_nothing(self.record.returns)
        return {
            **({"learned": nothing} if nothing else {}),
            "cell_id": self.cell.id,
            "task": self.cell.task,
            "agent": self.cell.agent,
            "seed": str(self.cell.seed),
            "hyperparameters": json.dumps(self.cell.hyperparameters, sort_keys=True),
            "auc": repr(auc(self.record.returns)),
            "best_return": repr(max(self.record.returns)),
            "sweep": sweep,
            "digest": self.knowledge.digest,
            "steps": steps_text(self.steps),
            "commit": self.record.commit,
        }


def steps_text(steps: Mapping[int, int]) -> str:
    """Return steps by seed as JSON, sorted by seed."""
    return json.dumps({str(seed): steps[seed] for seed in sorted(steps)})


def read_steps(text: str) -> dict[int, int]:
    """Return the steps that `steps_text` wrote. Raises ValueError for other text."""
    data = json.loads(text)
    if not isinstance(data, dict):
        raise ValueError(f"steps must be an object (got {text})")
    return {int(seed): int(steps) for seed, steps in data.items()}


def source_models(results: Results) -> list[SourceModel]:
    """Return the source models of a sweep, in the order of its plan.

    Pretrained sources are left out, and so are custom modules, which only their factory can build.
    """
    plan, library = results.plan(), SourceLibrary(results.storage)
    used = {source.cell_id for cell in plan.get("transfer", ()) for source in cell.sources}
    records = [results.record(cell.id) for cell in plan.get("source", ())]
    done = [record for record in records if record is not None and record.status == "done"]
    found = []
    for record in (record for record in done if record.cell.id in used and library.has(record.cell.id)):
        knowledge = library.load(record.cell.id)
        if "sizes" in knowledge.arrays and not knowledge.arrays["sizes"].size:
            continue
        group = [other for other in done if other.cell.group == record.cell.group]
        steps = {other.cell.seed: int(other.points["step"][-1] or 0) for other in group}
        found.append(SourceModel(record.cell, knowledge, record, steps))
    return found


def model_name(task: str) -> str:
    """Return the name of the registered model of a source task, in letters, digits, dots, dashes and underscores.

    Examples: deltatune-cartpole, deltatune-windy_gridworld-wind-reversed. An ambiguous or too long name ends in a hash
    of the task's name.
    """
    text = re.sub(r"[:=,]", "-", task)
    if re.fullmatch(r"[A-Za-z0-9_.-]+", text) and "-" not in task and len(text) <= MAX_CHARACTERS:
        return f"deltatune-{text}"
    text = re.sub(r"[^A-Za-z0-9_.]+", "-", text)[: MAX_CHARACTERS - 9].strip("-")
    return f"deltatune-{text}-{content_id(task)[:8]}"


def logged_name(name: str) -> str:
    """Return the name of a registered model's logged model, in which MLflow allows no dot."""
    return name.replace(".", "-")


def standing(tags: Mapping[str, str]) -> tuple[float, ...]:
    """Return the key by which the best version of a task is chosen: AUC; for deep tasks first the best evaluation."""
    score = float(tags["auc"])
    return (score,) if parse_task(tags["task"]).tabular else (float(tags["best_return"]), score)
