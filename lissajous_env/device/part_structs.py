"""The parts of a scenario as kernels see them."""

from lissajous_env.device.structs import struct_of
from lissajous_env.settings import parts, task

FormationStruct = struct_of(parts.Formation)
RobotStruct = struct_of(parts.Robot)
SensingStruct = struct_of(task.Sensing)
TargetStruct = struct_of(task.Targets)
FaultsStruct = struct_of(parts.Faults)
NoiseStruct = struct_of(parts.Noise)
TaskStruct = struct_of(task.Task)
