"""CartPole-v1 with the paper's limit of 200 steps (Table 3: gravity x 5 and x 7)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from trainables.tasks.spec.family import Context, ContextFeature, TaskFamily, number

if TYPE_CHECKING:
    import gymnasium


def build(context: Context) -> gymnasium.Env:
    """Return the environment, with the attributes that it derives from masses updated."""
    from gymnasium.envs.classic_control.cartpole import CartPoleEnv
    from gymnasium.wrappers import TimeLimit

    env = CartPoleEnv()
    env.gravity = context["gravity"]
    env.length = context["pole_length"]
    env.masspole = context["pole_mass"]
    env.masscart = context["cart_mass"]
    env.total_mass = env.masspole + env.masscart
    env.polemass_length = env.masspole * env.length
    return TimeLimit(env, int(context["limit"]))


def plain() -> gymnasium.Env:
    """Return Gymnasium's environment with the paper's limit."""
    import gymnasium

    return gymnasium.make("CartPole-v1", max_episode_steps=200)


FAMILY = TaskFamily(
    name="cartpole",
    description="balance a pole on a cart; +1 a step until it falls, 200 steps at most",
    features=(
        ContextFeature("gravity", 9.8, "gravity in m/s^2", number(0, 1000)),
        ContextFeature("pole_length", 0.5, "half of the pole's length in m", number(0.01, 100)),
        ContextFeature("pole_mass", 0.1, "mass of the pole in kg", number(0.001, 1000)),
        ContextFeature("cart_mass", 1.0, "mass of the cart in kg", number(0.001, 1000)),
        ContextFeature("limit", 200.0, "steps until an episode is truncated", number(1, 100_000)),
    ),
    defaults={"episodes": 4000, "hidden_size": 64, "batch_size": 64, "target_update": 2000},
    targets=("cartpole:gravity=5x", "cartpole:gravity=7x"),
    build=build,
    plain=plain,
    solved_at=195.0,  # Gymnasium's for CartPole-v0, which has this limit of 200 steps
)
