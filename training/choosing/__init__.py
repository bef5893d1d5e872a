"""Learned choices: a network that chooses, from the numbers of a scenario, which patrol a team drives."""
