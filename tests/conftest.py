"""Settings of every test: no window is opened, and none is waited for."""

import os

os.environ["SDL_VIDEODRIVER"] = "dummy"
os.environ["MPLBACKEND"] = "Agg"
