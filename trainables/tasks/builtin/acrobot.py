"""Acrobot-v1 (Table 3: link mass x 1.5 and x 2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trainables.tasks.spec.family import Context, ContextFeature, TaskFamily, number

if TYPE_CHECKING:
    import gymnasium


def build(context: Context) -> gymnasium.Env:
    """Return the environment. The links' moments of inertia (LINK_MOI) stay unchanged."""
    from gymnasium.envs.classic_control.acrobot import AcrobotEnv
    from gymnasium.wrappers import TimeLimit

    env = AcrobotEnv()
    if context["link_mass"] != 1.0:
        env.LINK_MASS_1 *= context["link_mass"]
        env.LINK_MASS_2 *= context["link_mass"]
    env.LINK_LENGTH_1 = context["link_length_1"]
    env.LINK_COM_POS_1 = context["link_length_1"] / 2
    env.LINK_LENGTH_2 = context["link_length_2"]
    env.LINK_COM_POS_2 = context["link_length_2"] / 2
    return TimeLimit(env, int(context["limit"]))


def plain() -> gymnasium.Env:
    """Return Gymnasium's environment."""
    import gymnasium

    return gymnasium.make("Acrobot-v1")


FAMILY = TaskFamily(
    name="acrobot",
    description="swing a two-link arm up to a height; -1 a step, 500 steps at most",
    features=(
        ContextFeature("link_mass", 1.0, "factor of the mass of both links", number(0.001, 1000)),
        ContextFeature("link_length_1", 1.0, "length of the inner link in m, its centre half-way", number(0.01, 100)),
        ContextFeature("link_length_2", 1.0, "length of the outer link in m, its centre half-way", number(0.01, 100)),
        ContextFeature("limit", 500.0, "steps until an episode is truncated", number(1, 100_000)),
    ),
    defaults={"episodes": 2000, "hidden_size": 256, "batch_size": 128, "target_update": 1000},
    targets=("acrobot:link_mass=1.5", "acrobot:link_mass=2"),
    build=build,
    plain=plain,
    solved_at=-100.0,  # Gymnasium's
)
