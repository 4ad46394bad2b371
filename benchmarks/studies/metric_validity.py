"""Compares each measure of similarity with the transfer ratios of a finished sweep of `metric-validity`, as Markdown.

`deltatune sweep metric-validity`, then `python -m benchmarks.studies.metric_validity results/metric-validity`: the
table on standard output, the figure metric_validity.png and the pairs, pairs.csv, in the sweep's folder `figures`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from dashboards.figures import metric_validity
from dashboards.renderers import matplotlib_renderer
from orchestrator.analysis.metric_validity import NAMES, correlations, table
from orchestrator.analysis.statistics import Estimate
from orchestrator.results.sweep_folder import Results


def _text(found: Estimate | None) -> str:
    if found is None:
        return "-"
    return f"{found.value:+.2f}" + (f" [{found.low:+.2f}, {found.high:+.2f}]" if found.low is not None else "")


def main() -> None:
    """Print the table and draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sweep", type=Path)
    folder: Path = parser.parse_args().sweep
    results = Results.open(folder.parent, str(folder))
    pairs = table(results.tables()[0])
    found = correlations(pairs)
    for source in dict.fromkeys(source for source, _, _ in found):
        agents = list(dict.fromkeys(agent for named, agent, _ in found if named == source))
        here = pairs[pairs["source"] == source]
        defined = here.dropna(subset=["ratio"])["target"].nunique()
        print(f"\nSource `{source}`, {here['target'].nunique()} targets, {defined} with a defined transfer ratio:\n")
        print("|measure|" + "|".join(agents) + "|")
        print("|---" * (len(agents) + 1) + "|")
        for name, words in NAMES.items():
            cells = [words.replace("|", r"\|"), *(_text(found.get((source, agent, name))) for agent in agents)]
            print("|" + "|".join(cells) + "|")
    drawn = matplotlib_renderer.draw(metric_validity.chart(found), results.name, results.folder / "figures")
    pairs.to_csv(results.folder / "figures" / "pairs.csv", index=False)
    print(f"\n{', '.join(str(path) for path in drawn)}")


if __name__ == "__main__":
    main()
