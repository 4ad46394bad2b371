"""All speed benchmarks in one table, and as JSON; `make bench` runs them.

    python -m benchmarks [PART ...] [--quick] [--json FILE]

Every figure is compared with a peer or a limit measured in the same run; the ratio is how many times better it is than
the peer, or the share of the limit that it reaches. `python -m benchmarks.compare A.json B.json` compares two commits.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import subprocess
from dataclasses import asdict
from pathlib import Path
from typing import Any

from llvmlite import binding

from benchmarks.row import Row, table
from benchmarks.suite import PARTS
from orchestrator.results.provenance import commit, versions


def machine() -> dict[str, Any]:
    """Return what the figures depend on besides the code: the machine and the versions."""
    wide = next((name for name in ("avx512f", "avx2", "neon") if binding.get_host_cpu_features().get(name)), "narrow")
    cores, load = len(os.sched_getaffinity(0)), round(os.getloadavg()[0], 1)
    return {
        "processor": binding.get_host_cpu_name(),
        "vectors": wide,
        "cores": cores,
        "load": load,
    }


def main() -> None:
    """Measure, print the table, and write it after every part; a part that fails costs no other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"some of {', '.join(PARTS)}; default: all")
    parser.add_argument("--quick", action="store_true", help="a tenth of the time, for a look")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the table there too")
    args = parser.parse_args()
    if unknown := set(args.parts) - set(PARTS):
        parser.error(f"no part '{min(unknown)}': there are {', '.join(PARTS)}")
    where, rows, failed = machine(), list[Row](), list[str]()
    print("  ".join(f"{name} {value}" for name, value in where.items()), flush=True)
    for name in args.parts or PARTS:
        try:
            found = list(PARTS[name](args.quick))
        except subprocess.CalledProcessError as error:
            failed.append(f"{name}: {shlex.join(error.cmd)} has ended with exit code {error.returncode}")
            continue
        print(f"\n{name}\n{table(found)}", flush=True)
        rows += found
        if args.json:
            data = {"commit": commit(), "versions": versions(), "machine": where, "rows": [asdict(row) for row in rows]}
            args.json.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    if failed:
        raise SystemExit("\n".join(failed))


if __name__ == "__main__":
    main()
