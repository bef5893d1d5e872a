"""Learned policies: the included ones, and their training."""

from training.choosing.chooser import chosen, load
from training.learned.onnx_graph import export_onnx
from training.learned.policy import Learned, names

__all__ = ["Learned", "chosen", "export_onnx", "load", "names"]
