"""Light that goes through media and over surfaces, in loops that Dr.Jit compiles: one kernel a pass.

`loop.py` is the loop, `media.py` flights and scatterings in it, `scene.py` what surrounds them, `passes.py` the pictures.
"""

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM
