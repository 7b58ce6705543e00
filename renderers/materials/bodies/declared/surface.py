"""The shape as a surface that is baked: no path goes inside."""

from __future__ import annotations

from renderers.materials.bodies.declaration import BodyMethod

METHOD = BodyMethod(
    name="surface", words="the shape's surface by the reflectance of the asset's plane layer, from afar", keys=("layer",),
    points=(), measured=None, beside=True, surface=True, stages=("medium", "surface"),
    brings="from the eye; at the shape's surface light is sent on as by a plane layer (stage surface), where lights are sampled",
    leaves_out="light leaves where it came in, as if under a plane that is lit evenly: shadows and edges are sharper, and thin "
               "parts darker, than light makes them that spreads in the material")
