"""One row per seed: where target seeds are crossed with source networks, a seed's cells are averaged first.

The cells of one seed, or of one source network, are no independent draws: an interval over all k x n of them would be
too narrow. The interval over the n means of the seeds is right for the k networks that are there; it says nothing of
others.
"""

from __future__ import annotations

import pandas as pd


def per_seed(cells: pd.DataFrame) -> pd.DataFrame:
    """Return the done cells of a configuration, a row per seed; numbers are means over its source networks.

    A seed counts once all of its cells are done.
    """
    done = cells[cells["status"] == "done"]
    if not done["seed"].duplicated().any():
        return done[~done["seed"].isin(_unfinished(cells))]
    done = done[~done["seed"].isin(_unfinished(cells))]
    numbers = [name for name in done.select_dtypes("number").columns if name != "seed"]
    rows = done.drop_duplicates("seed").set_index("seed")
    rows[numbers] = done.groupby("seed", sort=False)[numbers].mean()
    return rows.reset_index()


def networks(cells: pd.DataFrame) -> int:
    """Return how many source networks each seed of a configuration is crossed with."""
    return int(cells["seed"].value_counts().max()) if len(cells) else 0


def _unfinished(cells: pd.DataFrame) -> pd.Series:
    """Return the seeds with a cell that is not done."""
    return cells.loc[cells["status"] != "done", "seed"]
