"""Short cells of every agent, every family of tasks and every kind of source, and what each comes to.

A refactoring changes none of it: neither the id of a cell nor one bit of its curve. `python -m tests.golden.make`
writes golden.json anew; a change of it is a change of what recorded results mean, and belongs in the CHANGELOG.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from trainables import curve
from trainables.cell import Cell, Source
from trainables.knowledge import Knowledge
from trainables.own import load
from trainables.training.source_knowledge import source_knowledge
from trainables.training.train import train

HERE = Path(__file__).parent
FILE = HERE / "golden.json"
EXAMPLE = HERE.parents[1] / "docs" / "examples" / "fading_advice.py"
"""Its content may change, and so its pin and its cell's id; its curve may not."""

GRID = "windy_gridworld"
SMALL, MORE, REVERSED = f"{GRID}:wind=small", f"{GRID}:wind=additional_1", f"{GRID}:wind=reversed"
CHAIN = "supply_chain"
CART, HEAVY = "cartpole", "cartpole:gravity=5x"
TABULAR: dict[str, Any] = {"episodes": 30, "evaluate_every": 10}
LONGER: dict[str, Any] = {"episodes": 200, "evaluate_every": 50}
BRIEF: dict[str, Any] = {"episodes": 3, "evaluate_every": 2}
DEEP: dict[str, Any] = {
    "episodes": 20,
    "evaluate_every": 10,
    "evaluation_episodes": 3,
    "hidden_size": 16,
    "batch_size": 16,
    "target_update": 50,
    "epsilon_decay": 5.0,
    "learning_rate": 1e-3,
}
FEW: dict[str, Any] = DEEP | {"episodes": 2, "evaluate_every": 1, "evaluation_episodes": 1, "hidden_size": 20}

TRAIN = {"delta_after_advice": "train"}
"""What delta_es did before it could rest: the JSON of its cells does not say it."""

YOUNGER = "advised_factor", "advised_delta", "advised_paper_factor", "delta_sample_median"
"""Statistics that came after the digests called `curve`, which are without them; `whole` has every column."""

Named = Iterator[tuple[str, Cell]]


def exact(task: str = GRID) -> Source:
    """An exact source."""
    return Source(task=task, kind="exact")


def learned(cell: Cell, checkpoint: Any = "last", steps: int | None = None) -> Source:
    """The source that `cell` trains."""
    return Source(task=cell.task, kind="learned", cell_id=cell.id, checkpoint=checkpoint, steps=steps)


def sources() -> dict[str, Cell]:
    """The cells that train the learned sources."""
    wide = DEEP | {"hidden_size": 64, "batch_size": 128}
    return {
        "q_learning/source": Cell.create("q_learning", GRID, 0, LONGER),
        "q_learning/small": Cell.create("q_learning", SMALL, 1, LONGER | {"learning_rate": 0.1}),
        "dqn/cartpole": Cell.create("dqn", CART, 0, DEEP | {"episodes": 40}),
        "dqn/cartpole long": Cell.create("dqn", "cartpole:pole_length=2x", 1, DEEP),
        "dqn/cartpole wide": Cell.create("dqn", CART, 2, wide),
    }


def transfers() -> Named:
    """The other cells by a name to speak of them."""
    yield from _tabular()
    yield from _deep()
    yield from _baselines()
    yield from _other_tasks()


def _tabular() -> Named:
    grid = learned(sources()["q_learning/source"])
    small = learned(sources()["q_learning/small"])
    for agent in ("policy_reuse", "ppr", "delta_gate", "confidence_gate", "q_warm_start"):
        yield f"{agent}/exact", Cell.create(agent, REVERSED, 0, TABULAR, exact())
    moving = {"threshold": 3.0, "delta_learning_rate": 0.4, "epsilon_start": 0.3}
    yield "delta_gate/learned", Cell.create("delta_gate", SMALL, 2, TABULAR | moving, grid)
    yield "delta_gate/auto", Cell.create("delta_gate", MORE, 0, TABULAR | {"threshold": "auto"}, grid)
    sure = {"threshold": 2.0, "z": 1.0, "min_visits": 2, "truncation": "terminal"}
    yield "confidence_gate/learned", Cell.create("confidence_gate", SMALL, 3, TABULAR | sure, grid)
    yield "confidence_gate/auto", Cell.create("confidence_gate", MORE, 0, TABULAR | {"threshold": "auto"}, exact())
    yield "ppr/learned", Cell.create("ppr", REVERSED, 1, TABULAR | {"nu": 0.8}, grid)
    yield "delta_select/exact", Cell.create("delta_select", MORE, 0, TABULAR, [exact(), exact(SMALL), exact(REVERSED)])
    yield "delta_select/learned", Cell.create("delta_select", REVERSED, 1, TABULAR, [grid, small, exact(MORE)])
    yield "q_learning/supply chain", Cell.create("q_learning", f"{CHAIN}:demand_mean=5", 0, BRIEF)
    yield "delta_gate/supply chain", Cell.create("delta_gate", f"{CHAIN}:demand_mean=2", 0, BRIEF, exact(CHAIN))
    example = load(f"{EXAMPLE}:Agent")
    yield "fading_advice/exact", Cell.create(example, SMALL, 0, TABULAR | {"trust": 20.0}, exact())


def _deep() -> Named:
    cart = sources()["dqn/cartpole"]
    other = learned(sources()["dqn/cartpole long"], "best")
    half = learned(sources()["dqn/cartpole wide"], "best")
    best = learned(cart, "best")
    soon = learned(cart, "last", 400)
    """Its advice ends within the cell."""
    yield "dqn/huber", Cell.create("dqn", HEAVY, 1, DEEP | {"loss": "huber", "epsilon_unit": "steps"})
    yield "dqn/double", Cell.create("dqn", HEAVY, 1, DEEP | {"double": True})
    yield "dqn/terminal", Cell.create("dqn", HEAVY, 2, DEEP | {"truncation": "terminal", "replay_capacity": 100})
    full = DEEP | {"hidden_size": 256, "batch_size": 128}
    yield "dqn/full width", Cell.create("dqn", HEAVY, 3, full)
    yield "delta_es/half width", Cell.create("delta_es", HEAVY, 3, full | {"hidden_size": 64} | TRAIN, half)
    yield "es/learned", Cell.create("es", HEAVY, 0, DEEP, best)
    yield "es/shaped", Cell.create("es", HEAVY, 1, DEEP | {"evaluation_policy": "shaped"}, soon)
    yield "delta_es/learned", Cell.create("delta_es", HEAVY, 0, DEEP | {"advice_fraction": 1.0} | TRAIN, best)
    yield "delta_es/ends", Cell.create("delta_es", HEAVY, 1, DEEP | {"delta_learning_rate": 0.01} | TRAIN, soon)
    yield "delta_es/rests", Cell.create("delta_es", HEAVY, 1, DEEP | {"delta_learning_rate": 0.01}, soon)
    mended = DEEP | TRAIN | {"loss": "huber", "truncation": "terminal"}
    yield "delta_es/huber, terminal", Cell.create("delta_es", f"{CART}:limit=20", 0, mended, best)
    yield "dpba/learned", Cell.create("dpba", HEAVY, 0, DEEP, best)
    yield "delta_dpba/learned", Cell.create("delta_dpba", HEAVY, 0, DEEP, best)
    chosen = DEEP | {"memory": 5}
    yield (
        "delta_select_es/library",
        Cell.create("delta_select_es", HEAVY, 0, chosen | {"floor": "greedy"}, [best, other]),
    )
    yield "delta_select_es/exploring", Cell.create("delta_select_es", HEAVY, 0, chosen, [best, other])


def _baselines() -> Named:
    cart = sources()["dqn/cartpole"]
    best, soon = learned(cart, "best"), learned(cart, "last", 400)
    yield "warm_start/learned", Cell.create("warm_start", HEAVY, 0, DEEP, best)
    yield "warm_start/fresh", Cell.create("warm_start", HEAVY, 1, DEEP | {"last_layer": "fresh"}, soon)
    yield "safe_start/learned", Cell.create("safe_start", HEAVY, 0, DEEP | {"episodes": 40}, best)
    yield "safe_start/fresh", Cell.create("safe_start", HEAVY, 1, DEEP | {"begins": "fresh"}, soon)
    yield "corrected_es/learned", Cell.create("corrected_es", HEAVY, 0, DEEP, best)
    yield "corrected_es/shaped", Cell.create("corrected_es", HEAVY, 1, DEEP | {"evaluation_policy": "shaped"}, soon)
    brief = DEEP | {"floor_updates": 50}
    yield "relative_es/learned", Cell.create("relative_es", HEAVY, 0, brief | {"floor": "state"}, best)
    yield "relative_es/quantile", Cell.create("relative_es", HEAVY, 1, brief | {"floor": "quantile"}, soon)
    yield "jsrl/learned", Cell.create("jsrl", HEAVY, 0, DEEP, soon)
    yield "ppr_dqn/learned", Cell.create("ppr_dqn", HEAVY, 0, DEEP | {"nu": 0.8}, best)
    yield "kickstart/learned", Cell.create("kickstart", HEAVY, 0, DEEP, best)
    yield "kickstart/ends", Cell.create("kickstart", HEAVY, 1, DEEP | {"weight": 3.0, "temperature": 0.1}, soon)
    yield "replay_seed/learned", Cell.create("replay_seed", HEAVY, 0, DEEP | {"source_transitions": 300}, best)
    yield "dqinit/learned", Cell.create("dqinit", HEAVY, 0, DEEP | {"known_after": 5}, best)
    yield "constant_es/learned", Cell.create("constant_es", HEAVY, 0, DEEP, best)
    yield "shuffled_es/learned", Cell.create("shuffled_es", HEAVY, 0, DEEP, best)


def _other_tasks() -> Named:
    mountain = "gym:MountainCar-v0"
    yield "dqn/acrobot", Cell.create("dqn", "acrobot:link_mass=1.5", 0, FEW)
    yield "dqn/lunar lander", Cell.create("dqn", "lunar_lander:mass=1.1", 0, FEW)
    yield "dqn/reacher", Cell.create("dqn", "reacher:y_force=0.75", 0, FEW)
    yield "dqn/gym", Cell.create("dqn", f"{mountain}:gravity=2x", 0, FEW)
    yield "dqn/gym continuous", Cell.create("dqn", "gym:Pendulum-v1:levels=5", 0, FEW)
    yield "dqn/own task", Cell.create("dqn", load(f"{HERE / 'tank.py'}:Task:leak=1.5x"), 0, FEW)


def cells() -> dict[str, Cell]:
    """All of them."""
    return sources() | dict(transfers())


def digests() -> Iterator[tuple[str, dict[str, str]]]:
    """Names with the digests of their curves, `curve` and `whole`, the sources trained on the way."""
    known: dict[str, Knowledge] = {}
    for name, cell in cells().items():
        source = source_knowledge(cell, known.__getitem__) if cell.sources else None
        training = train(cell, source)
        table = curve.columns(training)
        older = {column: values for column, values in table.items() if column not in YOUNGER}
        yield name, {"curve": curve.digest(older), "whole": curve.digest(table)}
        known[cell.id] = training.knowledge()


def recorded() -> dict[str, dict[str, Any]]:
    """What golden.json says, by name: the cell, its id, and the digests of its curve."""
    result: dict[str, dict[str, Any]] = json.loads(FILE.read_text())
    return result
