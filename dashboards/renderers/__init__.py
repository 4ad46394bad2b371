"""Renderers that draw a figure's data: matplotlib and Plotly."""
