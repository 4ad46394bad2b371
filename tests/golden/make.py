"""`python -m tests.golden.make` writes golden.json anew."""

from __future__ import annotations

import json

from tests.golden import golden_cells


def make() -> str:
    """The content of golden.json."""
    cells = golden_cells.cells()
    found = {
        name: {"id": cells[name].id, **found, "cell": cells[name].to_json()} for name, found in golden_cells.digests()
    }
    return "{\n" + ",\n".join(f"{json.dumps(name)}: {json.dumps(entry)}" for name, entry in found.items()) + "\n}\n"


if __name__ == "__main__":
    golden_cells.FILE.write_text(make())
