"""Robots: a file for each model, the table of them, and what all have in common."""
