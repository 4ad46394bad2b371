"""`python -m tests.node_killer --minutes 60`: kill workers and nodes of a real cluster, and compare all bits."""

from __future__ import annotations

import argparse
import signal
import sys

from tests.node_killer.killer import kill

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Kill workers and nodes of a real cluster, and compare all bits")
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0, help="decides who dies when")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *words: sys.exit("asked to stop"))  # which ends the cluster too
    killed = kill(options.minutes, options.seed, say=True)
    print(killed)
    sys.exit(bool(killed.wrong))
