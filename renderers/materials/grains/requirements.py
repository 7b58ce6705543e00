"""What a scene of grains needs of a recipe: whether their statistics, how fine the grains are, which tiles."""

import math

import numpy as np

from renderers.materials.grains.declared import methods
from renderers.scene import meshes
from renderers.scene.budget import ROOM, as_much
from renderers.scene.requirements import Knob, Need

# Fewest triangles of a grain: at 1,300 the hit probability is 0.1 % off and all else within noise (docs/trade.md)
_COARSE, _FINE = 1300, 200_000
# Error of the phase function over that of a picture: it is the statistic that converges last, while albedo and lambda_s, of which
# the brightness of a heap is made, are 40 and 10 times as good (docs/trade.md).  `python benchmarks/requirements.py --pictures`
_BETTER = 1.0
# Tolerance of the recipe up to which spheres are packed with all care: the same grains stand in the same places, and only chords
# of the tile and the walk that measures sigma_t are known less well
SAME_TILE = 0.029
_WORST, _BEST = 0.5, 4e-4  # 2^28 paths, the most that are followed, leave 6/sqrt(paths)


def needs(about) -> list[Need]:
    """Requirements of the stages packing, grains and medium; see `renderers.scene.requirements`."""
    method = methods()[about.entry.method]
    if about.recipe.grains is None:
        return [Need(stage, True, "the renderer reads it") for stage in ("grains", "packing", "medium")]
    triangles, apart = _triangles(about, method)
    lacking = ""
    if about.dark:
        statistics, why = _WORST, "nothing in the scene shines: its picture is black"
    elif not method.medium:
        statistics, why = _WORST, f"method {method.name} traces the grains and reads no statistics of their light"
    else:
        statistics = float(np.clip(_BETTER * about.tables, _BEST, _WORST))
        why = about.share
        if _BETTER * about.tables < _BEST:
            lacking = f"statistics of {100 * about.tables:.2g} % are wanted, {100 * _BEST:g} % are asked for, " \
                      f"{as_much(_BEST / (_BETTER * about.tables))}"
    paths = Knob("scatterometer.tolerance", statistics, f"{100 * statistics:.3g}%", why, larger=False)
    return [Need("packing", True, "grains lie as in its tiles", tuple(_tiles(about))),
            Need("grains", True, apart, (paths, *triangles), lacking), Need("medium", True, _of_medium(method), (_walk(about),)),
            *_surface(about, method)]


def _surface(about, method) -> list[Need]:
    """The surface of grains: asked for, or in the recipe, where `auto` may take it, as single grains are not seen far off."""
    if method.surface_far:
        return [Need("surface", True, "light leaves what is far as by a plane of grains")]
    if not method.candidates or getattr(about.recipe, "surface", None) is None or about.dark:
        return []
    farthest = about.measured(_pixels_farthest)
    if farthest > ROOM * about.tolerance:
        return [Need("surface", False, f"grains are {farthest:.2g} pixels wide and more: single ones are seen everywhere")]
    return [Need("surface", True, f"at the farthest grains are {farthest:.2g} pixels wide: light may leave them as by a plane")]


def _walk(about) -> Knob:
    """sigma_t sets how far light spreads, not how much of it comes back: a wrong one blurs the picture, no more."""
    value = float(np.clip(about.tables, _BEST, SAME_TILE))
    return Knob("tolerance", value, f"{100 * value:.3g}%", "of sigma_t; up to there tiles are the same", larger=False)


def _of_medium(method):
    return "the chance of light samples goes by it" if not method.medium else "light goes on in it where grains are not seen"


# ---- grains


def _triangles(about, method):
    """Facets no larger than a pixel: N equilateral triangles of edge a on a sphere of diameter D are 4 pi/sqrt(3) (D/a)^2.

    The number is that of the nearest point of the meshes; a factor of two in the number is a margin of 1.4 in the edge.
    """
    if all(grain.shape.type == "sphere" for grain in about.recipe.grains.components):
        return (), "grains are exact balls"
    pixels = about.measured(_pixels)
    if method.continuous or about.dark:
        number, why = _COARSE, "no grain is seen, and statistics are within 0.1 %"
    else:
        number = int(np.clip(2 * 4 * math.pi / math.sqrt(3) * pixels**2, _COARSE, _FINE))
        why = f"facets of half a pixel's area, of grains {pixels:.2g} pixels wide" if number > _COARSE else \
            f"grains are {pixels:.2g} pixels wide, and statistics are within 0.1 %"
    return (Knob("scatterometer.triangles", number, str(number), why),), f"grains are {pixels:.2g} pixels wide at most"


def _radius(about):
    """Of the largest grain, m."""
    return 1e-6 * float(about.recipe.grains.radius) * _largest(about.recipe.packing.radii)


def _pixels_farthest(about):
    """Diameter of the largest grain at the farthest corner of its bodies, pixels."""
    corners = np.concatenate([meshes.of_entry(about.scene, number)[0] for number in about.bodies])
    farthest = float(np.max(np.linalg.norm(corners - about.camera.origin, axis=1)))
    return 2 * _radius(about) / max(about.camera.pixel * farthest, 1e-30)


def _pixels(about):
    """Diameter of the largest grain at the nearest point of its bodies, pixels."""
    from renderers.materials.grains import local, material

    radius, widest = _radius(about), 0.0
    for number in about.bodies:
        vertices, faces = meshes.of_entry(about.scene, number)
        local.check(about.scene, number, vertices)
        widest = max(widest, material.pixels_wide(about, vertices[faces], radius))
    return widest


def unseen(about) -> bool:
    """Whether no grain of its bodies can be told apart, so that a medium may stand for them beside other materials."""
    return about.recipe.grains is not None and about.measured(_pixels) <= ROOM * about.tolerance


def _largest(radii):
    """Largest radius of a tile over the mean."""
    if radii == "equal":
        return 1.0
    if isinstance(radii, tuple):
        return max(part.radius for part in radii) / sum(part.share * part.radius for part in radii)
    return math.exp(3 * math.log(radii.sigma))  # log-normal: one sphere in 740 is larger


# ---- tiles


def _tiles(about):
    """Of a dictionary of tiles the renderer reads one, the nearest that is as dense as the recipe's first fraction."""
    fractions = [float(fraction) for fraction in about.recipe.packing.fraction]
    if len(fractions) > 1:
        first = fractions[0]
        yield Knob("packing.fraction", first, f"[{first:g}]", f"bodies are filled at {first:g}, which is the first of "
                   f"{len(fractions)} tiles")
