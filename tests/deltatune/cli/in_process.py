"""Commands in this process."""

from __future__ import annotations

import contextlib
import io
import sys
from unittest import mock

from deltatune.cli.main import main


def command(*words: str) -> tuple[int, str, str]:
    """(exit code, standard output, standard error) of `deltatune WORDS`; a traceback is an error of the test."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with (
        mock.patch.object(sys, "argv", ["deltatune", *words]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
    return code, out.getvalue(), err.getvalue()
