"""Draft host side."""

from typing import NamedTuple, Any
import numpy as np
import warp as wp

from baselines import mpcc_kernel
from baselines.mpcc_kernel import COLD, KEEP, SHIFT, Scratch
from baselines.mpcc_model import MpccParameters, MpccStruct, vec5, tabulate
from lissajous_env.curve import CurveStruct
from lissajous_env.structs import to_struct

class Solution(NamedTuple):
    control: Any
    trajectory: Any
    cost: Any
    iterations: Any
    failed: Any

class Mpcc:
    def __init__(self, curve, parameters=MpccParameters(), batch=1, device="cpu"):
        self.parameters=parameters; self.batch=batch; self.device=device
        M=parameters.stages
        def rows(n,dtype):
            return wp.zeros((batch,n),dtype=dtype,device=device).transpose()
        s=Scratch(); s.state=rows(2*(M+1),vec5); s.control=rows(2*M,wp.vec2); s.change=rows(M,wp.vec2); s.gain=rows(2*M,vec5)
        self.scratch=s
        z=lambda shape,dt=float: wp.zeros(shape,dtype=dt,device=device)
        self.state=z((batch,5)); self.phase_rate=z(batch); self.begin=z(batch,int)
        self.control=z((batch,M,2)); self.trajectory=z((batch,M+1,5)); self.cost=z(batch); self.iterations=z(batch,int); self.failed=z(batch,int); self.failures=z(batch,int)
        self._launch=wp.launch(mpcc_kernel.solve,dim=batch,device=device,inputs=[to_struct(MpccStruct,parameters),to_struct(CurveStruct,curve),tabulate(curve,device),0,self.state,self.phase_rate,s,self.begin,self.control,self.trajectory,self.cost,self.iterations,self.failed,self.failures],record_cmd=True)
    def launch(self): self._launch.launch()
    def solve(self,state,phase_rate,guess=None):
        self.state.assign(np.asarray(state,np.float32)); self.phase_rate.assign(np.asarray(phase_rate,np.float32))
        if guess is not None:
            self.control.assign(np.asarray(guess,np.float32)); self.begin.fill_(KEEP)
        self.launch()
        return Solution(*(getattr(self,n).numpy().copy() for n in Solution._fields))
