"""The fast Q-network and its torch twin."""
