"""Policies outside the simulator: one robot's policy on its own computer, with the rules by which it stops."""

from baselines.onboard.robot import Limits, Onboard, Output
from baselines.onboard.signals import Command, Message, Odometry, Twist
from baselines.onboard.simulated import Inputs, inputs_of

__all__ = ["Command", "Inputs", "Limits", "Message", "Odometry", "Onboard", "Output", "Twist", "inputs_of"]
