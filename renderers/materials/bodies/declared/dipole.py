"""Later events by the directional dipole, for comparison."""

from renderers.materials.bodies.declaration import DIFFUSED, FEW, FEWEST_MET, BodyMethod

METHOD = BodyMethod(
    name="dipole", words="later events by the directional dipole, approximately, for comparison", parts=(FEW, DIFFUSED),
    second=lambda world, body: True, fewest_beams=FEWEST_MET, measured=None,
    brings="up to two events as in vrl, later ones by the directional dipole, a model of a half space",
    leaves_out="dipole is approximate: light scattered twice and more (layer orders) leaves as by diffusion under a plane, too "
               "bright, more so where more is absorbed; noisy where places of light are further apart than it spreads")
