"""Reacher-v5 with nine discrete actions (Table 3: a force of .75 and 1 along the y axis)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trainables.tasks.spec.family import Context, ContextFeature, TaskFamily, number

if TYPE_CHECKING:
    import gymnasium


def build(context: Context) -> gymnasium.Env:
    """Return the environment; features at their defaults do not change the physical model."""
    from gymnasium.wrappers import TimeLimit

    from trainables.tasks.builtin.reacher_env import DiscreteReacher

    env = DiscreteReacher(context["y_force"], context["control_cost"])
    if context["gravity"]:
        env.model.opt.gravity[1] = context["gravity"]
    if context["damping"] != 1.0:
        env.model.dof_damping[:2] = context["damping"]
    if context["gear"] != 200.0:
        env.model.actuator_gear[:, 0] = context["gear"]
    return TimeLimit(env, int(context["limit"]))


def plain() -> gymnasium.Env:
    """Return Gymnasium's environment with three levels of torque for each joint."""
    import gymnasium

    from trainables.tasks.wrappers.discretise import discretise

    return discretise(gymnasium.make("Reacher-v5"), 3)


FAMILY = TaskFamily(
    name="reacher",
    description="reach a point with a two-joint arm; each joint is pushed fully one way, the other way or not at all",
    features=(
        ContextFeature("y_force", 0.0, "force on the fingertip along y, in N", number(-1000, 1000)),
        ContextFeature("gravity", 0.0, "gravity along y in m/s^2; it moves the target too", number(-1000, 1000)),
        ContextFeature("damping", 1.0, "damping of both joints", number(0, 1000)),
        ContextFeature("gear", 200.0, "torque of both motors at full action", number(0, 10_000)),
        ContextFeature("control_cost", 1.0, "weight of the torques' squares in the reward", number(0, 1000)),
        ContextFeature("limit", 50.0, "steps until an episode is truncated", number(1, 100_000)),
    ),
    defaults={"episodes": 3000, "hidden_size": 256, "batch_size": 128, "target_update": 1000},
    targets=("reacher:y_force=0.75", "reacher:y_force=1"),
    build=build,
    plain=plain,
    extra="mujoco",
    solved_at=-3.75,  # Gymnasium's
)
