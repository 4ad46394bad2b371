"""Gymnasium's classic control environments as compiled step functions with the same bits."""
