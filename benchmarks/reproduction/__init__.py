"""docs/reproduction.md, written from the published dataset: `python -m benchmarks.reproduction`."""
