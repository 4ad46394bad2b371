"""The agents that come with deltatune, a file for each or for a family of them."""
