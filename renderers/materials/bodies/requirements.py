"""What a scene of translucent bodies needs of a recipe: whether tables of multiple scattering, how good, of how narrow lobes."""

import math
from types import SimpleNamespace

import numpy as np

from bakery import kernels
from renderers.materials.bodies import thin
from renderers.materials.bodies.bodies import refusal
from renderers.materials.bodies.declared import methods
from renderers.materials.surface import far
from renderers.mitsuba.shapes import index_fault
from renderers.scene.budget import DEFAULT, ROOM, as_much, percent
from renderers.scene.requirements import Knob, Need
from renderers.transport import solids

# The stated error of tables over the tolerance that they were asked for, 10 %: 0.40 (bumpy_sphere), 0.22 (wax), 0.11 (skin); the
# true error is half of that (docs/multiple-tables.md)
_REACHED = 0.4
# What the solver reaches at g = 0.9; tables of less may be out of reach, and are not where g is smaller (docs/multiple-tables.md)
_SOLVER = 0.003
_ORDERS = (16, 24, 32, 48, 64)  # Legendre orders from which a rule chooses
# Angle where the cap of a peak ends, rad, times the orders: at most 10 (bakery/physics/multiple/peaks.py).  Of Henyey-Greenstein
# it goes with the moment g^N of the last order: largest of g = 0.7 to 0.95, N = 12 to 48
_WIDEST, _OF_HG = 10.0, ((1e-3, 4.1), (0.035, 6.5))
_LARGER = 1.25  # margin of lengths
_UNSURE = 2.0  # times the error of a surface by diffusion may be off


def needs(about) -> list[Need]:
    """Requirements of the stages medium and multiple; see `renderers.scene.requirements`."""
    medium = Need("medium", True, "bodies are filled with it")
    method = methods()[about.scene.values.method]
    medium = [medium, *surface(about)] if method.candidates else [medium]
    if not (method.reads_tables or method.candidates):
        return [*medium, Need("multiple", False, f"method {method.name} looks up no tables")]
    if about.dark:
        return [*medium, Need("multiple", False, "nothing in the scene shines: its picture is black")]
    if method.candidates and not (_index(about) > 1 and about.world.without_extent):
        return [*medium, Need("multiple", False, "paths find all lights, and take less time than tables")]
    depth, across = about.measured(_sizes)
    later = thin.later(depth, about.medium.albedo, _index(about))
    worst = int(np.argmax(later))
    reason = f"optical depth {depth[worst]:.2g}, third and later events carry {_percent(later[worst])} of the light"
    knobs, lacking = _tolerance(about, later[worst])
    return [*medium, Need("multiple", True, reason, (knobs, *_orders(about, depth), *_extent(about, across)), lacking)]


def surface(about) -> list[Need]:
    """The surface of a recipe that has one, where `auto` may take it for its bodies: by diffusion, before anything is baked."""
    if getattr(about.recipe, "surface", None) is None or about.dark or about.world.camera is None:
        return []
    shapes, listed = about.world.shapes(), about.scene.values.materials
    if not {listed[number].where.shape for number in about.bodies} <= {shape.name for shape in shapes}:
        return []  # the renderer tells which there are
    if any(refusal(shapes, listed[number].where.shape, listed[number].index) for number in about.bodies):
        return [Need("surface", True, "nothing can fill the shape")]
    medium = {name: getattr(about.medium, name) for name in ("sigma_t", "albedo", "g")}
    unbaked, allowed = SimpleNamespace(medium=medium, surface={}), ROOM * (about.scene.values.tolerance or DEFAULT)
    least = min(far.deviation(about.scene, number, unbaked, about.world) for number in about.bodies)
    reason = f"an error of {_percent(least)} is expected where light leaves as by a layer"
    if least <= _UNSURE * allowed:
        return [Need("surface", True, reason)]
    from renderers.materials.surface import onset  # loads Dr.Jit

    share = max(onset.of(about.scene, number, unbaked, about.world).share for number in about.bodies)
    return [Need("surface", True, f"{_percent(share)} of its picture is far enough to be that of a layer")] if share > 0 else []


def _percent(share) -> str:
    return percent(share if share > 1e-12 else 0.0)  # rounding is all that is below


# ---- sizes


def _shapes(about):
    """Shapes of the Mitsuba scene that are bodies of the recipe."""
    named = {shape.name: shape for shape in about.world.shapes()}
    shapes = []
    for number in about.bodies:
        name = about.scene.values.materials[number].where.shape
        if name not in named or named[name].faces is None:
            key = f"materials[{number}].where.shape"
            meshes = ", ".join(sorted(shape.name for shape in named.values() if shape.faces is not None)) or "it has none"
            raise about.scene.wrong(key, f"found {name!r}, which is no mesh of the Mitsuba scene; expected the id of one: "
                                         f"{meshes}")
        index = about.scene.values.materials[number].index
        if named[name].index is not None and (fault := index_fault(name, index, named[name].index)):
            raise about.scene.wrong(f"materials[{number}].boundary.index", fault)
        shapes.append(named[name])
    return shapes


def _sizes(about):
    """Optical depth (L,) of the mean chord of the largest body, and of the longest way through any, the diagonal of its box."""
    chords, longest = [], []
    for shape in about.measured(_shapes):
        chords.append(solids.chord(shape.vertices, shape.faces))
        longest.append(float(np.linalg.norm(shape.box[1] - shape.box[0])))
    return max(chords) * about.medium.sigma_t, max(longest) * about.medium.sigma_t


def _index(about) -> float:
    return max(max(index, 1 / index) for index in (shape.index or 1.0 for shape in about.measured(_shapes)))


# ---- knobs


def _tolerance(about, later) -> tuple[Knob, str]:
    """Tables' error enters the picture by the light of third and later events, at most all of it."""
    wanted = about.tables / max(later, thin.FEW)
    value = float(np.clip(wanted / _REACHED, 1e-3, 0.1))
    lacking = "" if wanted >= _SOLVER else f"tables of {_percent(wanted)} are wanted; the solver reaches {_percent(_SOLVER)} " \
                                           f"at g = 0.9, {as_much(_SOLVER / wanted)}, and less where g is smaller"
    return Knob("multiple_scattering.tolerance", value, f"{100 * value:.3g}%",
                about.share, larger=False), lacking


def _orders(about, depth) -> tuple[Knob, ...]:
    """Fewest orders whose cap matters to little of the light.

    Light in the peak of the phase function counts as unscattered.  Two kinds of light differ by that, and each may be half of
    what tables may take: what only the peak has turned, exp(-tau (1 - albedo f)) - exp(-tau), which would be seen blurred through
    the body; and what of the light of one and two events is in the peak, f (1 - (albedo p')^2), unless every light is wider than
    the cap, so that from within it the same light comes.  f is the share above the phase function's value at the cap's end.
    """
    medium, widest = about.medium, about.measured(_narrowest_light)
    share = np.max(1 - thin.again(depth, medium.albedo, _index(about)))
    for orders in _ORDERS:
        angle = _cap(about, orders)
        peak = _peak(medium, angle)
        through = float(np.max(np.exp(-depth * (1 - medium.albedo * peak)) - np.exp(-depth)))
        turned = 0.0 if angle <= widest else share * float(peak.max())
        if max(through, turned) <= 0.5 * about.tables:
            return (Knob("multiple_scattering.orders", orders, str(orders),
                         f"of peaks within {math.degrees(angle):.2g} degrees {_percent(max(through, turned))} of the light would "
                         f"be seen; tables may take {_percent(about.tables)}"),)
    return ()


def _cap(about, orders) -> float:
    """Angle, rad, where the cap ends that takes the place of a peak, or more."""
    given = about.recipe.medium
    if given is None or given.phase.type != "hg":
        return _WIDEST / orders
    kept = float(np.max(np.abs(given.phase.g))) ** orders
    return next((width for moment, width in _OF_HG if kept <= moment), _WIDEST) / orders


def _narrowest_light(about) -> float:
    middle = np.mean([shape.box.mean(axis=0) for shape in about.measured(_shapes)], axis=0)
    return float(np.min(about.world.light_angles(middle)))


def _peak(medium, angle):
    """Share (L,) of the scattered light within an angle above the phase function's value there."""
    at = kernels.phase_at(medium.theta, medium.phase, np.array([angle]))
    cut = np.where(medium.theta < angle, np.minimum(medium.phase, at), medium.phase)
    return 1 - kernels.phase_integral(medium.theta, cut)


def _extent(about, across) -> tuple[Knob, ...]:
    """No place in a body is farther from another than across it; what light reaches ends it earlier.

    exp(-k r)(1 + k r) of the light of a point gets beyond r, k^2 = 3 (1 - albedo)(1 - albedo g) in mean free paths, too small a
    decay at large absorption: 1e-4 is left at k r = 11.8.
    """
    medium = about.medium
    decay = np.sqrt(3 * (1 - medium.albedo) * (1 - medium.albedo * medium.g))
    reach = 11.8 / np.maximum(decay, 11.8 / 200)
    value = float(np.clip(_LARGER * across.max(), 0.5, 200))
    if value >= reach.min():
        return ()  # auto: what the medium needs, at each wavelength
    return (Knob("multiple_scattering.extent", value, f"{value:.4g}",
                 f"bodies are {across.max():.3g} mean free paths across; a quarter more for what is beyond corners"),)
