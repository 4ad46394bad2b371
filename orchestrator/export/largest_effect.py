"""The largest effect of transfer in a file of best hyperparameters. Light to import."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from search_spaces.safe_yaml import read_yaml
from trainables.errors import InputError


def largest_effect(path: Path) -> dict[str, Any] | None:
    """Return the clearest gain by transfer in a file that `write_best` wrote, else the clearest loss, else None.

    The clearest is the one whose interval of the transfer ratio is farthest from 0; what was confirmed
    counts by its unseen seeds.
    """
    try:
        entries = read_yaml(path)["best"]
    except (InputError, KeyError, TypeError):
        return None
    effects = [
        {"task": entry["task"], "agent": entry["agent"], "source": entry["source"], **ratio}
        for entry in entries
        if (ratio := entry.get("confirmed", entry).get("transfer_ratio") or {}).get("low") is not None
    ]
    gains = [effect for effect in effects if effect["low"] > 0]
    losses = [effect for effect in effects if effect["high"] < 0]
    if gains:
        return max(gains, key=lambda effect: float(effect["low"]))
    return min(losses, key=lambda effect: float(effect["high"]), default=None)
