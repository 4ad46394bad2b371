"""A Python process that works for this one, and is told what to do over a socket."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Self


@dataclass
class ChildProcess:
    """The process, and this side of the connection to it."""

    process: subprocess.Popen[bytes]
    connection: Connection

    @classmethod
    def start(cls, code: str) -> Self:
        """Start a process that runs `code`, with the descriptor of its socket as the first argument.

        It imports from where this one does, and has no other input and output. Raises OSError where there can be none.
        """
        here, there = socket.socketpair()
        with there:
            path = os.pathsep.join(place or os.getcwd() for place in sys.path)
            process = subprocess.Popen(
                [sys.executable, "-c", code, str(there.fileno())],
                pass_fds=[there.fileno()],
                env=os.environ | {"PYTHONPATH": path},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
        return cls(process, Connection(here.detach()))

    def end(self) -> None:
        """End it at once."""
        self.connection.close()
        self.process.kill()
        self.process.wait()
