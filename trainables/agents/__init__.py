"""The agents and their hyperparameters. Light to import."""
