"""Light that goes through media and over surfaces: what is compiled of it by Dr.Jit, and wavefronts of paths for our own loops.

`loop.py` is the loop of Dr.Jit, one kernel a pass, `media.py` flights and scatterings in it, `scene.py` what surrounds them,
`passes.py` the pictures.  `waves.py` takes wavefronts through materials (`renderers.materials`), whose compiled loops share
`wavefront.py` (random streams, colours, sums, roulette) and `scattering.py`.
"""
