"""`deltatune contrast`: a pair, the family, a file, JSON, and one sentence for what is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest

from tests.deltatune.cli.in_process import command


def test_the_family_is_shown_and_says_for_how_many_it_is_corrected(finished: Path) -> None:
    code, out, _ = command("contrast", "small", "--storage", str(finished))
    assert code == 0
    first = next(line for line in out.splitlines() if "delta_gate" in line)
    assert first.split()[1:3] == ["delta_gate", "policy_reuse"]
    assert "p (Holm) is corrected for all 12 comparisons" in " ".join(out.split())


def test_a_pair_is_written_as_numbers(finished: Path, tmp_path: Path) -> None:
    file = tmp_path / "new" / "pair.csv"
    words = ("contrast", "small", "policy_reuse", "delta_gate", "--storage", str(finished), "-o", str(file), "--json")
    code, out, _ = command(*words)
    assert code == 0
    found = json.loads(out)
    table = pd.read_csv(file)
    assert found["comparisons"] == len(table) == len(found["contrasts"]) == 4
    assert list(table["difference"]) == [each["difference"] for each in found["contrasts"]]
    assert {(each["a"], each["b"]) for each in found["contrasts"]} == {("policy_reuse", "delta_gate")}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("delta_gat", "policy_reuse"), "did you mean 'delta_gate'"),
        (("delta_gate",), "two agents"),
        (("delta_gate", "delta_gate"), "delta_gate twice"),
        (("delta_gate", "policy_reuse", "--all"), "every pair of agents, or one"),
        (("-o", "table.xlsx"), "--output must name a .csv file"),
        (("--early",), "no two agents"),
    ],
)
def test_what_is_wrong_is_one_sentence(finished: Path, words: tuple[str, ...], says: str) -> None:
    code, out, err = command("contrast", "small", *words, "--storage", str(finished))
    assert (code, out) == (2, "")
    assert says in err
    assert err.count("\n") == 1
