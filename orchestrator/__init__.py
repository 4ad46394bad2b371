"""Plans and runs sweeps, keeps their results, and computes statistics, exports and MLflow copies from them."""
