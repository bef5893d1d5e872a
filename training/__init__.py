"""Learned policies: the included ones, and their training."""

from training.learned.onnx_graph import export_onnx
from training.learned.policy import Learned, load, names

__all__ = ["Learned", "export_onnx", "load", "names"]
