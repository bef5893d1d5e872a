"""Planning of patrols: candidates of several families, their simulation, and the Pareto-optimal ones."""
