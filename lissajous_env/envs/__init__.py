"""The environments: PettingZoo, Gymnasium, and a batch of either."""
