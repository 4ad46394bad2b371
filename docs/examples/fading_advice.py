"""A custom agent, complete: Q-learning whose advice from the source fades with each visit to a state."""

import numpy as np

from deltatune import NonNegative, StepLearner, Transfer, agent


class Settings(Transfer):
    """The hyperparameters of Q-learning, and how far the source is trusted."""

    trust: NonNegative = 10.0
    """The advantage A_src is weighted by trust / (1 + visits to the state)."""


class FadingAdvice(StepLearner):
    """Q-learning that acts on Q_trg + trust / (1 + n(s)) A_src."""

    def __init__(self, cell, source):
        super().__init__(cell, source)
        self.visits = np.zeros(len(self.q))
        self.advantage = self.q_src - self.q_src.max(axis=1, keepdims=True)

    def act(self, state):
        self.visits[state] += 1
        if self.rng.random() < self.epsilon:
            return int(self.rng.integers(self.q.shape[1]))
        factor = self.settings.trust / self.visits[state]
        return int((self.q[state] + factor * self.advantage[state]).argmax())

    def policy(self):
        factor = self.settings.trust / (1 + self.visits)
        return (self.q + factor[:, None] * self.advantage).argmax(axis=1)


Agent = agent(FadingAdvice, Settings, base="q_learning")
