"""The formats of `deltatune export`, as data. Light to import, since the command line is built from it."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from trainables.errors import unknown

if TYPE_CHECKING:
    from orchestrator.analysis.findings import Findings


@dataclass(frozen=True)
class Written:
    """What an export wrote."""

    what: str
    files: tuple[Path, ...]
    data: dict[str, Any]
    """The same data for `--json`; for tables, the names of the files."""


class Writer(Protocol):
    """Writes findings to a file, or to a folder."""

    def __call__(self, findings: Findings, path: Path) -> Written:
        """Write to `path`. Raises InputError where that fails, or the sweep has no such data."""


@dataclass(frozen=True)
class Format:
    """One format."""

    what: str
    """Its content, for the command's help."""
    file: str
    """The default file in the working folder; empty: a folder named after the sweep."""
    writer: str
    """'module:function' of its Writer."""

    def load(self) -> Writer:
        """Import the writer."""
        module, _, function = self.writer.partition(":")
        return cast(Writer, getattr(import_module(module), function))


_HERE = "orchestrator.export.writers"

FORMATS: dict[str, Format] = {
    "yaml": Format("the best hyperparameters", "best.yaml", f"{_HERE}:write_yaml"),
    "json": Format("the same as JSON", "best.json", f"{_HERE}:write_json"),
    "sb3": Format("the same as arguments of stable-baselines3's DQN", "best-sb3.json", f"{_HERE}:write_sb3"),
    "csv": Format("configurations with their statistics as numbers, cells and points", "", f"{_HERE}:write_csv"),
    "parquet": Format("the same as Parquet", "", f"{_HERE}:write_parquet"),
    "latex": Format("the table of the report", "table1.tex", f"{_HERE}:write_latex"),
}


def write(findings: Findings, form: str, output: Path | None = None) -> Written:
    """Write `findings` as `form`, one of FORMATS, to `output`, or to the format's default file.

    Raises InputError where the format is unknown, the file cannot be written, or the sweep has no such data.
    """
    if form not in FORMATS:
        raise unknown("format", form, FORMATS)
    chosen = FORMATS[form]
    return chosen.load()(findings, output or Path(chosen.file or findings.results.name))
