"""A custom agent that mostly waits: cells of seconds, during which much can be killed, and little for the processor."""

import time

from deltatune import StepLearner, Transfer, agent


class Patient(StepLearner):
    """Q-learning that waits before each evaluation."""

    def policy(self):
        """Return the greedy actions, in a while."""
        time.sleep(0.2)
        return self.q.argmax(axis=1)


Agent = agent(Patient, Transfer, base="q_learning")
