"""The compiled Q-network and its torch counterpart."""
