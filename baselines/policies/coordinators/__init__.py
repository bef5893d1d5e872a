"""Coordinators: the phase rate of each robot."""
