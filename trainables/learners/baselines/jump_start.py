"""Jump-start reinforcement learning: the source acts in the first steps of an episode."""

from __future__ import annotations

from trainables.learners.advice import Run
from trainables.learners.baselines.annealed import Annealed
from trainables.numerics.matmul import F32
from trainables.numerics.rng import stream
from trainables.tasks.registry import parse_task
from trainables.tasks.rollout import Rollout

EPISODES = 10
"""Episodes of the source on the target task; their mean length is the horizon H."""


class JumpStart(Annealed):
    """The source takes the first h = kappa H steps of an episode; then the agent acts as DQN does.

    H is the mean length of episodes of the source on the target task, which are played before training.
    """

    def begin(self, run: Run) -> None:
        """Play the source on the target task to measure the horizon."""
        task = run.cell.task
        with Rollout(parse_task(task), stream(run.cell.seed, "calibration", task)) as rollout:
            lengths = [len(rollout.episode(self.source).actions) for _ in range(EPISODES)]
        self._horizon = sum(lengths) / EPISODES
        self._left = 0

    @property
    def guide_steps(self) -> int:
        """Return h, the steps of the source at the start of an episode that begins now."""
        return round(self.kappa * self._horizon)

    def episode(self, number: int) -> None:
        """Compute h for the new episode."""
        self._left = self.guide_steps

    def guided(self, observation: F32) -> int | None:
        """Return the source's action in the first h steps."""
        if self._left <= 0:
            return None
        self._left -= 1
        return int(self.source.row(observation).argmax())

    def statistics(self, observations: F32) -> dict[str, float]:
        """Return kappa and h."""
        return super().statistics(observations) | {"guide_steps": float(self.guide_steps)}
