"""Makes the golden storage of this version: `python tests/formats/make.py FOLDER`, packed beside this file as .tar.xz.

A finished sweep of one seed with its MLflow store, and a checkpoint of a cell of the second seed, which growing it goes
on from. A file that is here stays as it is for ever: a change of the format adds another.
"""

from __future__ import annotations

import itertools
import json
import sys
import tarfile
from pathlib import Path

import yaml

from trainables.cell import Cell
from trainables.training.cell_run import run_cell

SPACE = {
    "schema": 1,
    "name": "formats",
    "family": "tests",
    "seeds": 1,
    "scenarios": [
        {
            "source": {
                "task": "windy_gridworld",
                "kinds": ["learned", "exact"],
                "hyperparameters": {"learning_rate": [0.5, 0.1]},
            },
            "targets": ["windy_gridworld:wind=small"],
        }
    ],
    "hyperparameters": {"episodes": [40], "evaluate_every": [10]},
    "agents": {"q_learning": {}, "delta_gate": {"threshold": [10.0]}},
}

KEPT = {".json", ".jsonl", ".parquet", ".yaml", ".csv", ".npz", ".checkpoint", ".log", ".db"}
"""Files that later versions read; pictures and pages are drawn anew."""

LEARNING = {"episodes": 40, "evaluate_every": 10, "learning_rate": 0.5}


def make(storage: Path) -> None:
    """Fill an empty folder."""
    from deltatune.cli.main import main

    (storage / "space.yaml").write_text(yaml.safe_dump(SPACE, sort_keys=False))
    words = ["sweep", str(storage / "space.yaml"), "--storage", str(storage), "--local", "--workers", "1"]
    sys.argv = ["deltatune", *words]
    try:
        main()
    except SystemExit as end:
        if end.code:
            raise
    checkpoint(storage / "formats" / "checkpoints")


def checkpoint(folder: Path) -> None:
    """Leave a cell of the second seed after its third evaluation."""
    cell, points = Cell.create("q_learning", "windy_gridworld", 1, LEARNING), itertools.count(1)
    run_cell(cell, lambda cell: None, keep=True, checkpoints=folder, stop=lambda: next(points) == 3)


def pack(storage: Path, file: Path) -> None:
    """Put what is kept of a storage into an archive."""
    with tarfile.open(file, "w:xz") as archive:
        for path in sorted(storage.rglob("*")):
            if path.is_file() and path.suffix in KEPT and "mlartifacts" not in path.parts:
                archive.add(path, path.relative_to(storage).as_posix())


def digests(storage: Path) -> dict[str, str]:
    """Cell id to the digest of its curve."""
    from orchestrator.results.sweep_folder import Results

    return {cell: head.digest for cell, head in sorted(Results.open(storage, "formats").heads().items())}


if __name__ == "__main__":
    made = Path(sys.argv[1])
    made.mkdir(parents=True)
    make(made)
    print(json.dumps(digests(made), indent=1))
