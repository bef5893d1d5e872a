"""Policies outside the simulator: one robot's policy on its own computer, with the rules by which it stops."""

from baselines.onboard.commands import Command, Twist
from baselines.onboard.inputs import Message, Odometry
from baselines.onboard.limits import Limits
from baselines.onboard.robot import Onboard, Output
from baselines.onboard.simulated import Inputs, inputs_of

__all__ = ["Command", "Inputs", "Limits", "Message", "Odometry", "Onboard", "Output", "Twist", "inputs_of"]
