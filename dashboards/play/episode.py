"""One greedy episode with its returns and images."""

from __future__ import annotations

import ctypes.util
import os
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trainables.errors import InputError
from trainables.tasks.make import make_env
from trainables.tasks.spec.family import Task
from trainables.tasks.step_env import Environment
from trainables.training.policy import Policy

Image = NDArray[np.uint8]
"""(height, width, 3)."""

MAX_IMAGES = 160
"""Images kept of an episode; a longer one skips steps."""
MAX_STEPS = 10_000
"""Steps after which an episode without a time limit is cut."""


@dataclass(frozen=True)
class Episode:
    """One episode."""

    title: str
    returns: tuple[float, ...]
    """(T + 1,): the undiscounted return before the first step, which is 0, and after each."""
    terminated: bool
    """Whether it ended in a terminal state, not at the time limit."""
    stride: int = 1
    """Steps from one image to the next."""
    images: tuple[Image, ...] = ()
    """After every `stride` steps, and after the last one."""
    states: tuple[int, ...] = ()
    """(T + 1,): the states of a tabular task."""

    @property
    def steps(self) -> int:
        """T, its number of steps."""
        return len(self.returns) - 1

    def image(self, step: int) -> Image:
        """Return the image after `step` steps, or the last one."""
        return self.images[-1] if step >= self.steps else self.images[step // self.stride]


def without_display() -> None:
    """Set the environment variables with which simulators draw without a display. Call before any is imported."""
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    if "MUJOCO_GL" not in os.environ and not os.environ.get("DISPLAY"):
        for name, library in (("egl", "EGL"), ("osmesa", "OSMesa")):
            if ctypes.util.find_library(library):
                os.environ["MUJOCO_GL"] = name
                return


def rendered(task: Task, title: str, policy: Policy, seed: int) -> Episode:
    """Play one episode and render it. Raises InputError for an environment that does not render."""
    made = make_env(task)
    render = renderer(made, task.name)
    images: list[Image] = []
    returns, stride, ended = [0.0], 1, False
    with closing(Environment(made, simulated=False)) as env:
        observation = env.reset(seed)
        images.append(render())
        while True:
            observation, reward, ended, truncated = env.step(policy(observation))
            returns.append(returns[-1] + reward)
            over = ended or truncated or len(returns) > MAX_STEPS
            if (len(returns) - 1) % stride == 0 or over:
                images.append(render())
            if over:
                break
            if len(images) > MAX_IMAGES:
                images, stride = images[::2], stride * 2
    return Episode(title, tuple(returns), ended, stride, tuple(images))


def renderer(env: Any, name: str) -> Callable[[], Image]:
    """Return a function that draws the current state. Raises InputError for an environment that cannot render."""
    inner = env.unwrapped
    if "rgb_array" not in (getattr(inner, "metadata", None) or {}).get("render_modes", ()):
        raise InputError(f"{name} cannot be played: its environment has no render mode 'rgb_array'")

    def render() -> Image:
        try:
            inner.render_mode = "rgb_array"
            return np.asarray(inner.render(), np.uint8)[..., :3]
        except Exception as error:  # the environment's own code and its graphics library
            reason = " ".join(str(error).split()) or type(error).__name__
            mujoco = any("mujoco" in base.__module__ for base in type(inner).__mro__)
            needs = ": MuJoCo needs EGL or OSMesa to draw without a display" if mujoco else ""
            raise InputError(f"{name} cannot be drawn here{needs} ({reason})") from None

    return render


def walked(task: Task, title: str, policy: Policy, seed: int) -> Episode:
    """Play one episode of a tabular task and record its states."""
    env = make_env(task)
    state, _ = env.reset(seed=seed)
    states, returns = [int(state)], [0.0]
    while True:
        state, reward, terminated, truncated, _ = env.step(policy(state))
        states.append(int(state))
        returns.append(returns[-1] + float(reward))
        if terminated or truncated:
            return Episode(title, tuple(returns), bool(terminated), states=tuple(states))
