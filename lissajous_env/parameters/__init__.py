"""Scenarios: their parts put together, their names, their files and the assumptions of the paper that they violate."""
