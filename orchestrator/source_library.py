"""The source library: trained source knowledge by the id of the cell that trained it."""

from __future__ import annotations

import re
from pathlib import Path

from orchestrator.files import make_folder
from trainables.atomic import write_atomic
from trainables.cell import Cell
from trainables.errors import InputError
from trainables.knowledge import Knowledge


class SourceLibrary:
    """A folder of .npz files without pickle; each is checked against its own checksum when it is read."""

    def __init__(self, storage: Path) -> None:
        self._folder = storage / "sources"

    def save(self, cell: Cell, knowledge: Knowledge) -> None:
        """Keep what `cell` has learned."""
        make_folder(self._folder)
        write_atomic(self.path(cell.id), knowledge.to_bytes({"cell": cell.to_json()}))

    def has(self, cell_id: str) -> bool:
        """Whether the cell's knowledge is there."""
        return self.path(cell_id).exists()

    def load(self, cell_id: str) -> Knowledge:
        """The knowledge of a cell; InputError where it is missing, damaged or another's."""
        path = self.path(cell_id)
        if not path.exists():
            raise InputError(f"the source library has no {path.name} (looked in {self._folder})")
        try:
            knowledge, meta = Knowledge.from_bytes(path.read_bytes())
            owner = Cell.from_json(meta.get("cell")).id
        except InputError as error:
            raise InputError(f"{path} is damaged ({error}): move it away and run the sweep again") from None
        if owner != cell_id:
            raise InputError(
                f"{path} holds the knowledge of another cell, {owner}: move it away and run the sweep again"
            )
        return knowledge

    def path(self, cell_id: str) -> Path:
        """The file of a cell's knowledge."""
        if not re.fullmatch(r"[0-9a-f]{16}", cell_id):
            raise InputError(f"a cell id is 16 hexadecimal digits (got '{cell_id}')")
        return self._folder / f"{cell_id}.npz"
