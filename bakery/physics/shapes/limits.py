"""What shapes, surfaces and mesh files may be: numbers that the makers of grains and the reader of recipes share.

Loads nothing, so that a recipe is checked before anything heavy is imported.
"""

from collections.abc import Mapping

# ---- shapes: least and most of each number
ASPECT = 1e4  # largest of three axes over the smallest
SHARE_HIT = 1e-3  # of the rays through the bounding sphere: 2^14 rays that hit are needed, which take seconds at this share
SEED = 0, 2**53
EXPONENTS = 0.1, 4.0  # of a superellipsoid
CORNERS = 8, 300  # of a rock
SHARPNESS = 4.0, 1000.0  # of edges; also inf
NOISE = 0.0, 0.3  # height of a rough surface over the radius, about
HABITS = "cube", "octahedron", "prism", "sucrose"
CHIPS = 0, 30  # corners cut off a crystal
DEPTH = 0.0, 0.6  # share of the height that one takes
ARRANGEMENTS = "cluster", "star"
BODIES = 1, 64  # of an aggregate
SMALLEST = 0.05, 1.0  # radius of its smallest body over the largest
LENGTH = 0.0, 10.0  # of a rod over its radius
OVERLAP = 0.05, 1.5  # of two bodies over the smaller radius
BLEND = 0.01, 0.5  # width over which grooves are filled, over the largest radius

# ---- meshes
LEVELS = {"coarse": 1_300, "middle": 20_000, "fine": 200_000}  # triangles
TRIANGLES = 20, 2_000_000  # that may be asked for
KINDS = "ply", "obj", "stl", "off"  # of files
BYTES = 256 << 20  # of a file
REPAIRS = ("pymeshlab",)  # programs that may repair one

# ---- surfaces
INDEX = 0.2, 5.0  # of a dielectric, relative to the host
# Nearer to the host's, but not it, light is turned by so little that a table of phase functions with an angle a degree does not
# show it: 1 - g of balls would be 3.2 times what it is at 1.001, 23 times at 1.0003
CONTRAST_MIN = 1e-3
ALPHA_MIN = 1e-4  # roughness below which a surface is smooth


def share_hit(shape: Mapping) -> float:
    """About which share of the rays through its bounding sphere hit a grain, from its proportions: 1 where it has none.

    A quarter of the surface is the mean projection of a convex body (Cauchy).  Exact for a box; of an ellipsoid to 1.1 %
    (K. Thomsen, 2004, in D. Cantrell's account, power 1.6075), which stands for all other shapes with axes.
    """
    if shape.get("type") == "box":
        a, b, c = shape.get("size", (1.0, 1.0, 1.0))
        return 2 * (a * b + b * c + c * a) / (3.141592653589793 * (a * a + b * b + c * c))
    if "axes" not in shape:
        return 1.0
    a, b, c = (axis / max(shape["axes"]) for axis in shape["axes"])
    return (((a * b) ** 1.6075 + (b * c) ** 1.6075 + (c * a) ** 1.6075) / 3) ** (1 / 1.6075)
