"""Learned policies: their card, weights and checkpoint, and how they act."""
