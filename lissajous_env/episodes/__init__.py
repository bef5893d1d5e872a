"""Episodes that a policy plays: the one loop, its score rows, its recording."""
