"""Gymnasium's classic control as compiled step functions, equal to it bit for bit."""
