"""The paper's model predictive contouring controller, problem (11)-(15), for a batch of cars at once."""

from baselines.mpcc.model import MpccParameters
from baselines.mpcc.solver import Mpcc

__all__ = ["Mpcc", "MpccParameters"]
