"""Trackers: what makes a robot follow a phase rate."""
