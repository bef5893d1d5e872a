"""Learned policies: shipped ones, and what trains them."""

from training.learned.onnx_graph import export_onnx
from training.learned.policy import Learned, load, names

__all__ = ["Learned", "export_onnx", "load", "names"]
