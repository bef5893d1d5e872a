"""Episodes: the loop in which a policy acts, score rows, recordings and bounds."""
