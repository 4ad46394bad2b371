"""Renderers of figures: matplotlib and Plotly."""
