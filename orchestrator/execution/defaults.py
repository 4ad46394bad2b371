"""What the command line and the Python API offer alike, in a module that imports nothing: a choice, and defaults."""

from __future__ import annotations

from typing import Literal

Reuse = Literal["all", "sources", "none"]
"""What a sweep takes from others in its storage: every cell that they have finished, sources only, or nothing."""

CHECKPOINT_SECONDS = 5.0
"""Seconds between the checkpoints of a long cell."""

KEEP_STATES = 4.0
"""Gigabytes of end states of finished cells that a stage keeps, from which longer cells continue."""
