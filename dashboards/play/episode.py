"""One greedy episode: what it returned, and what it looked like."""

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

MOST_IMAGES = 160
"""Most images that are kept of an episode; a longer one is shown in larger steps."""
MOST_STEPS = 10_000
"""Where an episode without a time limit is cut."""


@dataclass(frozen=True)
class Episode:
    """One episode."""

    title: str
    returns: tuple[float, ...]
    """The undiscounted return after each step, (T + 1,), from 0 on."""
    terminated: bool
    """Whether it has ended by itself, not at the time limit."""
    stride: int = 1
    """Steps from one image to the next."""
    images: tuple[Image, ...] = ()
    """After every `stride` steps, and after the last one."""
    states: tuple[int, ...] = ()
    """(T + 1,): of a tabular task."""

    @property
    def steps(self) -> int:
        """T."""
        return len(self.returns) - 1

    def image(self, step: int) -> Image:
        """Return what was to be seen after `step` steps, or at the end."""
        return self.images[-1] if step >= self.steps else self.images[step // self.stride]


def without_display() -> None:
    """Let simulators draw without a display, where the environment says nothing else; before any is imported."""
    os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    if "MUJOCO_GL" not in os.environ and not os.environ.get("DISPLAY"):
        for name, library in (("egl", "EGL"), ("osmesa", "OSMesa")):
            if ctypes.util.find_library(library):
                os.environ["MUJOCO_GL"] = name
                return


def rendered(task: Task, title: str, policy: Policy, seed: int) -> Episode:
    """Play one episode of an environment that renders; InputError for one that does not."""
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
            over = ended or truncated or len(returns) > MOST_STEPS
            if (len(returns) - 1) % stride == 0 or over:
                images.append(render())
            if over:
                break
            if len(images) > MOST_IMAGES:
                images, stride = images[::2], stride * 2
    return Episode(title, tuple(returns), ended, stride, tuple(images))


def renderer(env: Any, name: str) -> Callable[[], Image]:
    """Return what draws the environment as it stands; InputError for one that does not render, or cannot here."""
    inner = env.unwrapped
    if "rgb_array" not in (getattr(inner, "metadata", None) or {}).get("render_modes", ()):
        raise InputError(f"{name} cannot be played: its environment has no render mode 'rgb_array'")

    def render() -> Image:
        try:
            inner.render_mode = "rgb_array"
            return np.asarray(inner.render(), np.uint8)[..., :3]
        except Exception as error:  # the environment's own code and its graphics library
            said = " ".join(str(error).split()) or type(error).__name__
            mujoco = any("mujoco" in base.__module__ for base in type(inner).__mro__)
            needs = ": MuJoCo needs EGL or OSMesa to draw without a display" if mujoco else ""
            raise InputError(f"{name} cannot be drawn here{needs} ({said})") from None

    return render


def walked(task: Task, title: str, policy: Policy, seed: int) -> Episode:
    """Play one episode of a tabular task, and keep its states."""
    env = make_env(task)
    state, _ = env.reset(seed=seed)
    states, returns = [int(state)], [0.0]
    while True:
        state, reward, terminated, truncated, _ = env.step(policy(state))
        states.append(int(state))
        returns.append(returns[-1] + float(reward))
        if terminated or truncated:
            return Episode(title, tuple(returns), bool(terminated), states=tuple(states))
