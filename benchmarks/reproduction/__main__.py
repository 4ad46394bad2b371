"""Write docs/reproduction.md and its figures from the published dataset."""

from __future__ import annotations

import argparse
from pathlib import Path

import jinja2
import pandas as pd

from benchmarks.reproduction import figures, others, safe, summary, tables
from benchmarks.reproduction.claims import DEMANDS, MARGIN
from benchmarks.reproduction.curves import Published, published
from benchmarks.reproduction.verdicts import findings
from orchestrator.analysis import statistics
from orchestrator.dataset.dataset import Dataset

PAIRS = (
    *(
        ("windy_gridworld", f"windy_gridworld:wind={wind}")
        for wind in ("small", "additional_1", "additional_2", "reversed")
    ),
    *(("supply_chain", demand) for demand in DEMANDS),
)


def page(dataset: Dataset, parts: Published) -> str:
    """Return the page; `parts` are the dataset's."""
    curves = parts.paper
    found, standings = findings(curves, parts.fractions), safe.standings(parts.safe)
    rivals, pairs = others.tables(parts.baselines)
    similar = figures.similarities(curves)
    correlation = (
        statistics.rank_correlation(list(similar["delta"]), list(similar["ratio"])) if len(similar) > 2 else None
    )
    return jinja2.Template(
        (Path(__file__).parent / "page.md.j2").read_text(), keep_trailing_newline=True, trim_blocks=True
    ).render(
        cells=f"{dataset.cells['cell_id'].nunique():,}",
        hours=f"{dataset.cells.drop_duplicates('cell_id')['seconds'].sum() / 3600:.1f}",
        in_short=summary.sentences(parts, found, standings),
        margin=f"{MARGIN:.0%}",
        comparisons=len({each.comparison for _, all_of in found for each in all_of if each.p is not None}),
        table_1=tables.table_1(curves),
        progress=tables.progress(curves),
        early=tables.early(curves),
        fractions=bool(figures.advice_fractions(parts.fractions).panels),
        safe=standings,
        safe_table=safe.table(standings, parts.safe) if standings else "",
        safe_differences=safe.differences(standings, parts.safe) if standings else "",
        rivals=rivals,
        pairs=pairs,
        sentences=tables.sentences(found),
        verdicts=tables.verdicts(found),
        theorems=tables.theorems(PAIRS),
        figure1=_similarity(correlation, similar),
        tabular=tables.tabular(curves),
    )


def _similarity(correlation: statistics.Estimate | None, similar: pd.DataFrame) -> str:
    if correlation is None:
        return ""
    return (
        f"Over these {len(similar)} targets of one gridworld, the source's own task among them, the rank correlation "
        f"of the exact max |delta| with the transfer ratio of reuse is {correlation.value:+.2f}.{_gap(similar)}"
    )


def _gap(similar: pd.DataFrame) -> str:
    """Return where reuse begins to hurt, as a sentence; empty where max |delta| does not tell."""
    helped, hurt = (similar.loc[side, "delta"] for side in (similar["ratio"] > 0, similar["ratio"] <= 0))
    if helped.empty or hurt.empty or helped.max() >= hurt.min():
        return ""
    return (
        f" Reuse helps on the {len(helped)} with at most {helped.max():.1f} and hurts on the {len(hurt)} with at least "
        f"{hurt.min():.1f}; nothing lies between."
    )


def main() -> None:
    """Write the page and its figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--dataset", type=Path, default=Path("docs/dataset"))
    parser.add_argument("--docs", type=Path, default=Path("docs"), help="the folder of reproduction.md")
    arguments = parser.parse_args()
    dataset = Dataset(arguments.dataset)
    parts = published(dataset)
    (arguments.docs / "reproduction.md").write_text(page(dataset, parts))
    figures.draw(parts, arguments.docs / "images" / "reproduction")
    print(arguments.docs / "reproduction.md")


if __name__ == "__main__":
    main()
