"""Command lines and files that chance makes: every one ends as documented, and leaves no trace where it should not.

300 of them, the same each time. `DELTATUNE_FUZZ=3000 pytest tests/deltatune/cli/test_fuzz.py` makes more, and
`DELTATUNE_FUZZ_SEED` others. Nothing is trained: a sweep is asked for with --dry-run alone, and its costs are given.
"""

from __future__ import annotations

import copy
import os
import random
import traceback
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
import yaml
from conftest import SPACE

from tests.deltatune.cli.in_process import command
from tests.orchestrator.local_sweeps import snapshot
from trainables.training.throughput import Rate

TRIES = int(os.environ.get("DELTATUNE_FUZZ", "300"))
SEED = int(os.environ.get("DELTATUNE_FUZZ_SEED", "0"))
BATCHES = 10

NUMBERS = (
    *("0", "1", "-1", "2", "0.5", "1e8", "1e44", "1e308", "-1e308", "1e400", "inf", "-inf", "nan", "", " ", "x"),
    *(
        "9" * 30,
        "9" * 5000,
        "1" + 49 * "0",
        "10000",
        "10001",
        "2147483648",
        "9223372036854775808",
        "0x10",
        "1_000",
        "٣",
    ),
)
WORDS = (
    *("", " ", ".", "..", "-x", "--", "a\nb", "\x1b[31m", "\x7f", "\udcff", "😀", "ä", "a" * 300, "a/" * 3000, "small"),
    *("demo", "../small", "/", "/dev/null", "/dev/zero", "~", "$HOME", "%s", "{}", "[bold]", "'", '"', "a:b", "NaN"),
    *("gym:", "gym:No-v0", "x.py:Y", "x.py@00000000:Y", "cartpole", "cartpole:gravity=1e309x", "cartpole:gravity"),
    *("windy_gridworld", "windy_gridworld:wind=[1]", "windy_gridworld:wind=reversed", "a=b", "=", "episodes=", "☃=1"),
)
STORAGES = ("s3://", "s3:///", "http://x", "://", "file://", "file:///dev/null", "zip://a", "/dev/null/x", "y" * 300)
VALUES: tuple[Any, ...] = (
    *(None, True, 0, 1, -1, 3, 10**12, 2**63, 10**30, 0.5, -0.5, 1e308, float("inf"), float("nan"), "", "x", "a\nb"),
    *([], {}, [1], [1, 1], ["x"], {"low": 1, "high": 0}, {"low": 0, "high": 1}, {"values": []}, {"a": {"b": {}}}),
    *([0.1] * 20_000, list(range(300)), "9" * 5000, "windy_gridworld", "cartpole", "q_learning", "\x1b[2J", {1: 2}),
)
EPISODES = ("2", "0", "-1", "1e9", "9" * 30, "nan", "")
"""Of a ranking: few, or none that is allowed."""

READING = ("report", "export", "status", "list", "logs", "watch", "compare", "replay", "sources", "rank", "bounds")
WRITING = ("best.yaml", "out", "file/x", "there", "n" * 300, "/dev/null/x", "new/deep/file.yaml")
"""Places for a command's output; those that can be written to are in the working folder, never in the storage."""


class Maker:
    """Makes command lines from a seed."""

    def __init__(self, seed: int, storage: Path) -> None:
        self.chance = random.Random(seed)
        self.storage = str(storage)

    def words(self) -> list[str]:
        """Return one command line."""
        pick = self.chance.choice
        kinds = (self.sweep, self.sweep, self.space, self.space, self.reading, self.reading, self.catalogue, self.text)
        words: list[str] = pick(kinds)()
        if self.chance.random() < 0.1:
            words.insert(self.chance.randrange(len(words) + 1), pick(("--what", "-z", "--json", "--help", pick(WORDS))))
        return words

    def sweep(self) -> list[str]:
        """A sweep with options out of order, never one that would run."""
        pick = self.chance.choice
        options = ("--seeds", "--workers", "--checkpoint-every", "--time-limit", "--cpus-per-cell", "--memory-per-cell")
        words = ["sweep", pick(("demo", "demo", "small-table1", pick(WORDS)))]
        for _ in range(self.chance.randint(0, 3)):
            words += pick(
                (
                    [f"{pick(options)}={pick(NUMBERS)}"],
                    [f"--name={pick(WORDS)}"],
                    [f"--set={pick(('episodes', 'gamma', 'hidden_size', pick(WORDS)))}={pick(NUMBERS + WORDS)}"],
                    [f"--tasks={pick(WORDS)}"],
                    [f"--agents={pick(WORDS)}"],
                    [f"--params={pick(WORDS)}"],
                    [f"--tracking-uri={pick(WORDS)}"],
                    ["--local"],
                    ["--retry-failed"],
                )
            )
        return [*words, *self.stored(), "--dry-run"]

    def space(self) -> list[str]:
        """A sweep of a file that is not what it was."""
        data = copy.deepcopy(SPACE)
        for _ in range(self.chance.randint(1, 2)):
            self.spoil(data)
        text = yaml.safe_dump(data, allow_unicode=True)
        if self.chance.random() < 0.3:
            cut = self.chance.randrange(len(text))
            text = (
                text[:cut] + self.chance.choice(("", "\t", "[" * 500, "&a", "*a", "!!python/none", ": :")) + text[cut:]
            )
        Path("space.yaml").write_text(text, encoding="utf-8", errors="surrogateescape")
        return ["sweep", "space.yaml", "--dry-run", *self.stored()]

    def spoil(self, data: Any) -> None:
        """Put another value somewhere into `data`."""
        keys = list(data) if isinstance(data, dict) else list(range(len(data)))
        key = self.chance.choice(keys) if keys else None
        if key is None:
            return
        if isinstance(data[key], dict | list) and data[key] and self.chance.random() < 0.7:
            self.spoil(data[key])
        elif isinstance(data, dict) and self.chance.random() < 0.2:
            data.pop(key)
        else:
            data[key] = copy.deepcopy(self.chance.choice(VALUES))

    def reading(self) -> list[str]:
        """A command on sweeps that are there."""
        pick, name = self.chance.choice, self.chance.choice(READING)
        given = {
            "list": [],
            "sources": [pick(("list", "verify", "add", "import", "remove", pick(WORDS))), pick(WORDS)],
            "compare": [pick(WORDS), pick(WORDS)],
            "rank": [
                pick(WORDS),
                f"--episodes={pick(EPISODES)}",
                f"--seed={pick(NUMBERS)}",
            ],
            "bounds": ["windy_gridworld", pick(WORDS), f"--gamma={pick(NUMBERS)}"],
        }.get(name, [pick(WORDS)])
        if name in ("report", "export") and self.chance.random() < 0.5:
            given += ["-o", pick(WRITING)]
        if name == "export" and self.chance.random() < 0.5:
            given += [f"--format={pick(('yaml', 'json', 'csv', 'latex', 'sb3', 'parquet', pick(WORDS)))}"]
        if name == "report":
            given = [pick([word for word in WORDS if "small" not in word])]  # drawing takes seconds, and writes
        return [name, *given, *(() if name == "bounds" else self.stored())]

    def catalogue(self) -> list[str]:
        """A command on what there is."""
        pick = self.chance.choice
        return [
            pick(("tasks", "agents", "spaces", "init", "mv", "rm")),
            *(pick(WORDS) for _ in range(pick((0, 1, 1, 2)))),
        ]

    def text(self) -> list[str]:
        """Words without a meaning."""
        return [self.chance.choice(WORDS + NUMBERS) for _ in range(self.chance.randint(0, 4))]

    def stored(self) -> list[str]:
        """The storage, by an option, or a bad one."""
        return [f"--storage={self.storage if self.chance.random() < 0.85 else self.chance.choice(STORAGES)}"]


def fault(words: list[str], code: int, out: str, err: str) -> str:
    """What is wrong with how a command has ended; empty where nothing is."""
    if code not in (0, 1, 2, 3):
        return f"exit code {code}"
    if code == 2 and not (len(err.strip("\n").splitlines()) == 1 or (not err and "Usage" in out)):
        return f"not one line: {err!r}"
    if code == 2 and err and not (err.startswith("error: ") and err.strip("\n").isprintable()):
        return f"not a sentence: {err!r}"
    return f"a traceback: {err}" if "Traceback" in err else ""


@pytest.mark.parametrize(
    "batch", [pytest.param(batch, marks=pytest.mark.slow if batch > 4 else ()) for batch in range(BATCHES)]
)
def test_whatever_is_typed_ends_as_documented(
    batch: int, finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("orchestrator.execution.forecast.measure", lambda cell: Rate(1e-6, 100.0, 200, 1e-3))
    Path("file").write_text("")
    Path("there").mkdir()
    before, maker, codes = snapshot(finished), Maker(SEED + batch, finished), Counter[int]()
    for _ in range(TRIES // BATCHES):
        words = maker.words()
        try:
            code, out, err = command(*words)
        except BaseException:
            pytest.fail(f"{words}\n{traceback.format_exc()}")
        assert not fault(words, code, out, err), words
        codes[code] += 1
    assert snapshot(finished) == before
    assert codes[2] > codes.total() / 4
