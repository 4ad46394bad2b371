"""plan.json: every cell that a sweep asks for, by stage.

On an object store each driver writes a file of its own, plan-NUMBER-TOKEN.json, of which the highest number counts: a
driver that was frozen in the middle of a write, and has lost its lease, cannot replace the plan of the present one.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orchestrator.results import checked_json
from orchestrator.results.lock import Hold
from trainables.storage import disk
from trainables.storage.paths import is_local, sizes

PLAN = "plan.json"
_NUMBERED = re.compile(r"plan-(\d+)-[0-9a-f]+\.json")


@dataclass
class PlanFile:
    """The file in `folder`. Only the driver of the sweep writes it."""

    folder: Path
    _hold: Hold | None = None
    _mine: Path | None = None
    """The file of this driver on an object store."""

    def guard(self, hold: Hold) -> None:
        """Write only while `hold` is valid."""
        self._hold, self._mine = hold, None

    def path(self) -> Path:
        """Return the file that counts, whether or not it exists."""
        if is_local(self.folder):
            return self.folder / PLAN
        numbered = self._numbered()
        return self.folder / (max(numbered, key=lambda name: (numbered[name], name)) if numbered else PLAN)

    def write(self, data: dict[str, Any]) -> None:
        """Write the plan with its checksum, atomically. Raises LeaseLostError where this driver is no longer one."""
        if self._hold is not None:
            self._hold.check()
        if self._hold is None or not self._hold.token:
            checked_json.write(self.folder / PLAN, data)
            return
        if self._mine is not None:
            checked_json.write(self._mine, data)
            return
        before = self._numbered()
        number = max(before.values(), default=0) + 1 + self._hold.takeovers
        self._mine = self.folder / f"plan-{number:06d}-{self._hold.token}.json"
        checked_json.write(self._mine, data)
        older = [PLAN, *sorted(before, key=lambda name: (before[name], name))]
        for name in older[:-1]:  # a reader may be about to read the last one
            disk.remove(self.folder / name)

    def _numbered(self) -> dict[str, int]:
        """Return the numbers of the drivers' files."""
        found = {name: _NUMBERED.fullmatch(name) for name in sizes(self.folder)}
        return {name: int(match[1]) for name, match in found.items() if match}
