"""Which agents there are, and their hyperparameters. Light to import."""
