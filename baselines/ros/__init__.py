"""ROS 2: robots as nodes, the simulation in place of their hardware, and both launched together."""
