"""ROS 2: robots as nodes, the simulation as stand-in for their hardware, and both launched together."""
