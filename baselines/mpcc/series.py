"""The kernel of `baselines.mpcc.kernel` for curves of harmonics.

It is in a module of its own, which is compiled only where such a curve is driven and leaves the rounding of the other
kernel alone.
"""

import warp as wp

from baselines.mpcc import kernel
from baselines.mpcc.frame import Series
from lissajous_env.device.compilation import CONTRACTED

wp.set_module_options(CONTRACTED)

solve_series = wp.overload(wp.Kernel(kernel.solve.func, module=wp.get_module(__name__)), {"curve": Series})
