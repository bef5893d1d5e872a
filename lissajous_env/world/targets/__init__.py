"""Targets: how they appear, move and are detected."""
