"""Which trials Tune runs: the packs of one stage after the other, and trials that hold workers between them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import ray

from orchestrator.errors import InterruptedSweepError
from orchestrator.execution.executors.executor import StageRun
from orchestrator.execution.executors.monitor import StageMonitor
from trainables.training.tune_worker import HOLD

HOLD_SECONDS = 60.0
"""Longest time for which an idle worker is held for the next stage; starting a new one takes a few seconds."""


class Trials:
    """The configs of trials, as Tune asks for them, over all stages of a sweep.

    A worker for which a stage has no pack left gets a trial that does nothing but hold it until the next stage is
    planned: Tune would end it. The same trials start the workers that only the next stage needs.
    """

    def __init__(self, first: StageRun, rest: Iterator[StageRun], asked_to_stop: Callable[[], bool]) -> None:
        """asked_to_stop: whether the user has asked the sweep to stop."""
        self._rest, self._asked_to_stop = rest, asked_to_stop
        self._held: set[str] = set()
        self._let_go = 0
        self.over = False
        """Whether all stages have ended."""
        self.error: Exception | None = None
        """The error that ended the last stage, or planning the next one."""
        self._begin(first)

    def _begin(self, stage: StageRun) -> None:
        self._stage, self._held, self._let_go = stage, set(), 0
        self._payload = ray.put(stage.payload)

    @property
    def monitor(self) -> StageMonitor:
        """Return the monitor of the stage that runs, or ran last."""
        return self._stage.monitor

    def next(self, trial: str) -> dict[str, Any] | None:
        """Return the config of a new trial; None where there is none now, or no more (see `over`)."""
        while not self.over:
            queue = self.monitor.queue
            queue.stopping |= self._asked_to_stop()
            if (pack := self.monitor.next(trial)) is not None:
                cells = json.dumps([cell.to_json() for cell in pack.cells])
                return {"cells": cells, "together": pack.together, "payload": self._payload}
            if not queue.over():
                return self._hold(trial)
            self._advance()
        return None

    def _advance(self) -> None:
        """End the stage, and begin the next one."""
        try:
            stage = next(self._rest, None)
        except Exception as error:
            self.error, stage = error, None
        if stage is None:
            self.over = True
        else:
            self._begin(stage)

    def finish(self) -> None:
        """End what Tune was stopped in. Raises the error of a stage that could not end or begin."""
        if self.error is not None:
            raise self.error
        if not self.over:
            self.monitor.queue.stopping = True
            if next(self._rest, None) is not None:
                raise InterruptedSweepError

    def _hold(self, trial: str) -> dict[str, Any] | None:
        queue = self.monitor.queue
        workers = len(self.monitor.workers) if queue.at_once is None else queue.at_once
        if not self._keeps() or len(queue.running) + len(self._held) + self._let_go >= workers:
            return None
        self._held.add(trial)
        return {HOLD: HOLD_SECONDS}

    def _keeps(self) -> bool:
        """Return whether idle workers are kept for the next stage."""
        queue = self.monitor.queue
        return not self.over and self._stage.followed and queue.drained() and not queue.stopping

    def holds(self, trial: str) -> bool:
        """Return whether a trial that holds a worker goes on."""
        goes_on = trial in self._held and self._keeps()
        if not goes_on:
            self._held.discard(trial)
        return goes_on

    def let_go(self, trial: str) -> None:
        """Note that a trial that held a worker has ended by itself, or was lost: that worker is held no more."""
        if trial in self._held:
            self._held.remove(trial)
            self._let_go += 1
