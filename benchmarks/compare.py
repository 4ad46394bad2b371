"""Compares two runs of `make bench`: `python -m benchmarks.compare A.json B.json`.

`change` compares the figures themselves, which also depend on the machine and its load; `of ratios` compares the ratios
to the peers and limits measured in the same run, and is valid across machines. Above 1: B is better.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from benchmarks.row import Row

Key = tuple[str, str]


def read(path: Path) -> tuple[dict[str, Any], dict[Key, Row]]:
    """Return the machine and the rows of a file. Raises ValueError for a file of another kind."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        rows = [Row(**row) for row in data["rows"]]
        return {"commit": data["commit"], **data["machine"]}, {(row.name, row.beside): row for row in rows}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"'{path}' is not a file written by 'python -m benchmarks --json' ({error})") from None


def compared(before: dict[Key, Row], after: dict[Key, Row]) -> list[str]:
    """Return a line for each row that both have, then one for each that only one has."""
    lines = [f"{'':36}{'compared with':<30}{'A':>12}{'B':>12}  {'':14}{'change':>8}{'of ratios':>11}"]
    for key in (key for key in before if key in after):
        a, b = before[key], after[key]
        change = Row("", b.value, "", "", a.value, b.more).ratio
        ratios = b.ratio / a.ratio if a.ratio else float("nan")
        lines.append(
            f"{a.name:<36}{a.beside:<30}{a.value:>12.4g}{b.value:>12.4g}  {a.unit:<14}{change:>8.2f}{ratios:>11.2f}"
        )
    for name, rows, others in (("A", before, after), ("B", after, before)):
        lines += [f"{key[0]} compared with {key[1]}: only in {name}" for key in rows if key not in others]
    return lines


def main() -> None:
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, metavar="A.json")
    parser.add_argument("after", type=Path, metavar="B.json")
    args = parser.parse_args()
    try:
        (here, before), (there, after) = read(args.before), read(args.after)
    except ValueError as error:
        parser.error(str(error))
    for name, data in (("A", here), ("B", there)):
        print(f"{name}: " + "  ".join(f"{key} {value}" for key, value in data.items()))
    if {key: here[key] for key in ("processor", "cores")} != {key: there[key] for key in ("processor", "cores")}:
        print("two machines: only the last column is valid")
    print("\n".join(compared(before, after)))


if __name__ == "__main__":
    main()
