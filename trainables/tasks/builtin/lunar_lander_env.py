"""LunarLander whose lander is heavier or lighter; imports Box2D, so only a task that is built imports this."""

from __future__ import annotations

from typing import Any

from gymnasium.envs.box2d.lunar_lander import LunarLander


class HeavyLander(LunarLander):
    """LunarLander with `mass` times the lander's density; the legs keep theirs."""

    def __init__(self, mass: float = 1.0, **settings: Any) -> None:
        super().__init__(**settings)
        self._mass = mass
        self._weighed: Any = None

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """One step. `reset` builds a lander and ends with a first step: it is weighed there, before it has moved."""
        if self.lander is not self._weighed:
            self._weighed = self.lander
            if self._mass != 1.0:
                _weigh(self.lander, self._mass)
        step: Any = super().step
        result: tuple[Any, Any, bool, bool, dict[str, Any]] = step(action)
        return result


def _weigh(lander: Any, factor: float) -> None:
    for fixture in lander.fixtures:
        fixture.density *= factor
    lander.ResetMassData()
