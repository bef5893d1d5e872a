"""The world: its state, the stages of a step, and the score."""
