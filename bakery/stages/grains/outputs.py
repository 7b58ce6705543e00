"""What the stage `grains` stores: names, shapes, units and ranges."""

import math

from bakery.stages.declaration import ANY, SIGNED, Output

PEAK = 1e-3  # rad, second angle of the table: room for unscattered (delta) transmission, in tables of media
SCALARS = ("hit_probability", "lambda_delta", "chord")
FIGURES = ("albedo", "lambda_s", "lambda_o", "mean_square", "g", "forward_delta", "inner_path")
BY_RADIUS = ("albedo", "lambda_s", "mean_square", "g", "forward_delta")
LOSSLESS = ("lambda_s", "mean_square", "g", "forward_delta")
SHARES = ("hit_probability", "albedo", "forward_delta", "contradicted", "lost")
ASKED = ("hit_probability", "lambda_delta", "albedo", "lambda_s", "mean_square", "g", "phase")
_SAID = {
    "hit_probability": ("1", "share of rays through the bounding sphere that meet the surface"),
    "lambda_delta": ("1", "mean chord of the bounding sphere of rays that do not, in its radii"),
    "chord": ("1", "mean chord of the bounding sphere of rays that do, in its radii"),
    "albedo": ("1", "share of the light that hits which leaves"),
    "lambda_s": ("1", "mean displacement from entry to exit of the sphere along the incoming direction, in its radii"),
    "lambda_o": ("1", "the same along the outgoing direction"),
    "mean_square": ("1", "mean squared distance of entry and exit, in squared radii"),
    "g": ("1", "mean cosine of the light that leaves, undeflected light included"),
    "forward_delta": ("1", "share of the light that leaves in its old direction"),
    "inner_path": ("1", "mean path length inside the grain of the light that leaves, in radii of the sphere"),
    "phase": ("1/sr", "phase function of light that leaves changed, linear in cos theta; a node holds the mean over its cell"),
}
# what is thrown back may leave the sphere before where it entered
_WITHIN = dict.fromkeys(SHARES, (0, 1)) | {"g": SIGNED, "lambda_s": ANY, "lambda_o": ANY}


def _with_errors(prefix: str, names, shape: str, **options) -> tuple[Output, ...]:
    return tuple(Output(f"{prefix}{name}{end}", shape, _SAID[name][0], ("standard error of " + name) if end else _SAID[name][1],
                        within=_WITHIN.get(name + end, (0, math.inf)), **options) for name in names for end in ("", "_error"))


OUTPUTS = (
    Output("theta", "(A,)", "rad", "angle between the directions of travel, from 0 (forward) to pi", within=(0, math.pi)),
    Output("radius", "(S,)", "m", "radii of bounding spheres that stand for the law of sizes"),
    Output("radius_share", "(S,)", "1", "share of the grains at each radius, adding up to 1", within=(0, 1)),
    Output("COMPONENT/vertices", "(V, 3)", "1", "corners of the exemplar, in radii of its bounding sphere", within=(-1.01, 1.01)),
    Output("COMPONENT/faces", "(F, 3)", "1", "triangles, counterclockwise from outside; of a sphere for pictures only",
           within=(0, "V - 1"), whole=True),
    Output("COMPONENT/weight", "(1,)", "1", "share of the number of grains", within=(0, 1)),
    Output("COMPONENT/shape", "(bytes,)", "utf-8", "shape as in the recipe (JSON)"),
    Output("COMPONENT/surface", "(bytes,)", "utf-8", "surface, indices relative to the host (JSON)"),
    Output("COMPONENT/interior", "(L,)", "1/m", "absorption coefficient of the inside"),
    *_with_errors("COMPONENT/", SCALARS, "(1,)"),
    *_with_errors("COMPONENT/", FIGURES, "(L,)"),
    *_with_errors("COMPONENT/", ("phase",), "(L, A)"),
    Output("COMPONENT/paths", "(1,)", "1", "rays that were followed; 0: closed form", whole=True),
    Output("COMPONENT/hits", "(1,)", "1", "rays that met the surface", whole=True),
    Output("COMPONENT/events", "(1,)", "1", "meetings with the surface of a ray that hits"),
    Output("COMPONENT/contradicted", "(1,)", "1", "share of rays given up because inside and outside did not agree",
           within=(0, 1)),
    Output("COMPONENT/lost", "(1,)", "1", "share of the light of hits that was still under way when its path was cut"),
    *_with_errors("COMPONENT/by_radius/", BY_RADIUS, "(S, L)", optional=True),
    *_with_errors("COMPONENT/by_radius/", ("phase",), "(S, L, A)", optional=True),
    *_with_errors("COMPONENT/lossless/", LOSSLESS, "(L,)"),
)
_SIZED = "COMPONENT/by_radius"
TOGETHER = ((_SIZED, *(output.path for output in OUTPUTS if output.path.startswith(f"{_SIZED}/") and
                       not output.path.endswith("_error"))),)
