"""LunarLander-v3 (Table 3: lander mass x 1.1 and x 1.5; Table 1: x 0.75)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trainables.tasks.spec.family import Context, ContextFeature, TaskFamily, number

if TYPE_CHECKING:
    import gymnasium


def build(context: Context) -> gymnasium.Env:
    """Return the environment; wind power or turbulence enables its wind."""
    from gymnasium.wrappers import TimeLimit

    from trainables.tasks.builtin.lunar_lander_env import HeavyLander

    env = HeavyLander(
        mass=context["mass"],
        gravity=context["gravity"],
        enable_wind=bool(context["wind_power"] or context["turbulence_power"]),
        wind_power=context["wind_power"],
        turbulence_power=context["turbulence_power"],
    )
    return TimeLimit(env, int(context["limit"]))


def plain() -> gymnasium.Env:
    """Return Gymnasium's environment."""
    import gymnasium

    return gymnasium.make("LunarLander-v3")


FAMILY = TaskFamily(
    name="lunar_lander",
    description="land softly between two flags with three engines, 1000 steps at most",
    features=(
        ContextFeature("mass", 1.0, "factor of the lander's mass", number(0.01, 100)),
        ContextFeature("gravity", -10.0, "vertical gravity in m/s^2", number(-11.999, -0.001)),
        ContextFeature("wind_power", 0.0, "largest force of the wind", number(0, 20)),
        ContextFeature("turbulence_power", 0.0, "largest torque of the wind", number(0, 2)),
        ContextFeature("limit", 1000.0, "steps until an episode is truncated", number(1, 100_000)),
    ),
    defaults={"episodes": 3000, "hidden_size": 256, "batch_size": 128, "target_update": 1000},
    targets=("lunar_lander:mass=1.1", "lunar_lander:mass=1.5", "lunar_lander:mass=0.75"),
    build=build,
    plain=plain,
    extra="box2d",
    solved_at=200.0,  # Gymnasium's
)
