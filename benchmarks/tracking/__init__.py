"""What recording a sweep in MLflow costs."""
