"""Environments for PettingZoo and Gymnasium, single and in batches."""
