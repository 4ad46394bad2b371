"""What people look at: figures, their renderers, and the report."""
