"""Sources as registered models, and back."""
