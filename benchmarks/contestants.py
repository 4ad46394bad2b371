"""The learners that `learner_speed` compares, each doing the same work: one update per environment step."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import torch

from trainables.cell import Cell, Source
from trainables.learners.dqn import DeepLearner
from trainables.tasks.make import make_env
from trainables.tasks.registry import families, parse_task

EPSILON = 0.1
"""Constant exploration, the same for all, so that all query their network equally often."""

Contestant = Callable[[float], tuple[int, float]]
"""CPU seconds to work for -> (environment steps, CPU seconds used)."""


def ours(task: str, agent: str = "dqn") -> Contestant:
    """Return the agent of this package; delta_es with its advice on throughout, its most expensive phase."""
    given: dict[str, Any] = {"episodes": 10**9, "epsilon_start": EPSILON, "epsilon_end": EPSILON}
    knowledge, source = None, None
    if agent != "dqn":
        knowledge = DeepLearner(Cell.create("dqn", task, 1, given), None).knowledge()
        source = Source(task=task, kind="learned", cell_id="0" * 16, steps=10**9)
    learner = DeepLearner(Cell.create(agent, task, 0, given, source), knowledge)

    def work(seconds: float) -> tuple[int, float]:
        first, start = learner.steps, time.process_time()
        while time.process_time() - start < seconds:
            learner.run(1)
        return learner.steps - first, time.process_time() - start

    return work


def stable_baselines(task: str) -> Contestant:
    """Return stable-baselines3's DQN with the same network, batch, buffer and target copies."""
    from stable_baselines3 import DQN
    from stable_baselines3.common.callbacks import BaseCallback

    size, batch, target = _sizes(task)

    class Until(BaseCallback):
        deadline = 0.0

        def _on_step(self) -> bool:
            return time.process_time() < self.deadline

    model = DQN(
        "MlpPolicy",
        make_env(parse_task(task)),
        learning_rate=1e-4,
        buffer_size=10_000,
        learning_starts=batch,
        batch_size=batch,
        train_freq=1,
        gradient_steps=1,
        target_update_interval=target,
        exploration_initial_eps=EPSILON,
        exploration_final_eps=EPSILON,
        policy_kwargs={"net_arch": [size, size]},
        device="cpu",
        seed=0,
    )
    callback = Until()

    def work(seconds: float) -> tuple[int, float]:
        first, start = model.num_timesteps, time.process_time()
        callback.deadline = start + seconds
        model.learn(10**9, callback=callback, log_interval=10**9, reset_num_timesteps=False)
        return model.num_timesteps - first, time.process_time() - start

    return work


def plain_torch(task: str) -> Contestant:
    """Return a single-file DQN loop in plain torch, in the style of CleanRL."""
    loop = _PlainLoop(task)

    def work(seconds: float) -> tuple[int, float]:
        first, start = loop.steps, time.process_time()
        while time.process_time() - start < seconds:
            loop.step()
        return loop.steps - first, time.process_time() - start

    return work


class _PlainLoop:
    def __init__(self, task: str) -> None:
        size, self.batch, self.target_update = _sizes(task)
        self.env: gymnasium.Env[Any, Any] = make_env(parse_task(task))
        space: Any = self.env.action_space
        self.actions, inputs = int(space.n), int(np.prod(self.env.observation_space.shape or ()))
        self.q, self.target = (
            torch.nn.Sequential(
                torch.nn.Linear(inputs, size),
                torch.nn.ReLU(),
                torch.nn.Linear(size, size),
                torch.nn.ReLU(),
                torch.nn.Linear(size, self.actions),
            )
            for _ in range(2)
        )
        self.target.load_state_dict(self.q.state_dict())
        self.optimiser = torch.optim.Adam(self.q.parameters(), 1e-4)
        self.rng = np.random.default_rng(0)
        self.observations, self.following = (np.zeros((10_000, inputs), np.float32) for _ in range(2))
        self.taken = np.zeros(10_000, np.int64)
        self.rewards, self.ends = (np.zeros(10_000, np.float32) for _ in range(2))
        self.steps = 0
        self.observation, _ = self.env.reset(seed=0)

    def step(self) -> None:
        if self.rng.random() < EPSILON:
            action = int(self.rng.integers(self.actions))
        else:
            with torch.no_grad():
                q = self.q(torch.as_tensor(self.observation, dtype=torch.float32)[None])
            action = int(q.argmax(1).item())
        following, reward, terminated, truncated, _ = self.env.step(action)
        at = self.steps % 10_000
        self.observations[at], self.following[at] = self.observation, following
        self.taken[at], self.rewards[at], self.ends[at] = action, reward, terminated
        self.observation = self.env.reset()[0] if terminated or truncated else following
        self.steps += 1
        if self.steps >= self.batch:
            self.learn()
        if self.steps % self.target_update == 0:
            self.target.load_state_dict(self.q.state_dict())

    def learn(self) -> None:
        rows = self.rng.integers(0, min(self.steps, 10_000), self.batch)
        with torch.no_grad():
            best = self.target(torch.as_tensor(self.following[rows])).max(1).values
            ends = torch.as_tensor(self.ends[rows])
            target = torch.as_tensor(self.rewards[rows]) + 0.99 * best * (1 - ends)
        q = self.q(torch.as_tensor(self.observations[rows]))
        loss = torch.nn.functional.mse_loss(target, q.gather(1, torch.as_tensor(self.taken[rows])[:, None])[:, 0])
        self.optimiser.zero_grad()
        torch.autograd.backward(loss)
        torch.nn.utils.clip_grad_norm_(self.q.parameters(), 10.0)
        self.optimiser.step()


def _sizes(task: str) -> tuple[int, int, int]:
    """Return units of each hidden layer, batch size, steps between target copies (Table 6)."""
    defaults = families()[task].defaults
    return int(defaults["hidden_size"]), int(defaults["batch_size"]), int(defaults["target_update"])
