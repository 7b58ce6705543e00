"""Light samples through boundaries of bodies, for the loop: through smooth ones those of small lamps (`lamps`), and of wide ones
(`wide`); through rough ones of all lights (`rough`)."""

from __future__ import annotations

from typing import NamedTuple

import drjit as dr
import numpy as np

from renderers.mitsuba.shading import by_number
from renderers.transport import lamps, rough, solid_angles, wide
from renderers.transport.guides import Guides, Sight
from renderers.transport.lamps import Lamps
from renderers.transport.manifold import Manifold
from renderers.transport.records import Records
from renderers.transport.rough import Rough
from renderers.transport.skies import Sky
from renderers.transport.wide import BLUR, Wide, ways

import mitsuba as mi  # isort: skip

# Of lights that are not drawn as lamps: more than this share of the mean square of what ways to lights find (window of a glass of
# milk 1, skies beside small lamps 0.001), and more contrast
_SHARE, _CONTRAST = 0.1, 3.0
# Of walks that end: where fewer do, directions are drawn for all lights.  Variance times time with directions over with walks,
# under a lamp of 25 mm: milk that shares the tumbler's inner wall, 2 of 100 walks end, 0.34; inside of the glass, 82, 1.67
_SUCCESS = 0.5
# The same contrast of lights through rough boundaries: ball of roughness 0.1 under a panel, variance times time with
# over without light samples 1.07 at 6.4, 0.26 at 56
_CONTRAST_OF_ROUGH = 10.0


class Before(NamedTuple):
    """Direction of paths before a surface turned them, and the bodies in which they were."""

    direction: mi.Vector3f
    inside: mi.UInt32


class Samples:
    """All kinds, each of which may be None.

    small : `Lamps`;  wide : `Wide`, of all other lights;  rough : `Rough`
    """

    def __init__(self, scene, small, wide, rough):
        self._scene, self.small, self.wide, self.rough = scene, small, wide, rough

    def none(self, width):
        """What paths that have not scattered keep for each: fields of a `state.Path`."""
        return {"departure": self.small and self.small.none(width), "chance": self.wide and self.wide.none(width),
                "entry": self.rough and self.rough.none(width)}

    def records(self, lanes, paths):
        """`Records` of lanes that follow so many paths each, and their `Counts`."""
        waves = self._scene.waves
        kinds = {"scattering": (lamps.Scattering, lamps.SCATTERINGS, waves),
                 "arrival": (lamps.Arrival, lamps.ARRIVALS, 3)} if self.small else {}
        kinds |= {"wide": (Sight, wide.SPACE, waves)} if self.wide else {}
        kinds |= {"rough": (Sight, rough.SPACE, waves)} if self.rough else {}
        records = Records(kinds, lanes, paths)
        return records, records.counts()

    def departs(self, path, medium, position, density, active, records):
        """Of paths that scatter at positions, and go on with density (1/sr)."""
        if self.small:
            self.small.departs(path, medium, position, density, active, records)
        if self.wide:
            self.wide.departs(path, medium, position, active, records)
        if self.rough:
            self.rough.departs(path, medium, position, active, records)

    def turned(self, path, before, sample, shades):
        """Of paths that a surface has turned, by a sample of the BSDF; before : `Before`."""
        if self.small:
            self.small.turned(path, sample, shades)
        if self.wide:
            self.wide.turned(path, before, sample, shades)

    def meets(self, path, event, emitter, light, records):
        """Light that paths meet, without what light samples bring of it."""
        if self.small:
            light = self.small.meets(path, event, light, records)
        light = self.wide.meets(path, emitter, light) if self.wide else light
        return self.rough.meets(path, light) if self.rough else light

    def sampled(self, path, event, light):
        """Light of light samples at events, without what others bring of it."""
        return self.rough.sampled(path, event, light) if self.rough else light

    def light(self, records):
        """What records come to: numbers (n,) of paths, orders (n,), emitters (n,) by their numbers, and light (n, 3)."""
        for kind in filter(None, (self.small, self.wide, self.rough)):
            for number, order, emitter, light in kind.light(records):
                emitter = self._scene.light_number(emitter)
                dr.eval(number, order, emitter, light)
                columns = [np.asarray(column) for column in (number, order, emitter, *light)]
                yield *columns[:3], np.stack(columns[3:], axis=1)


def samples(scene, world, bodies):
    """`Samples` of a scene, None where no light is to be drawn.

    scene : `scene.Scene`;  bodies : by the numbers of their media
    """
    kinds = *_through_smooth(scene, world, bodies), _through_rough(scene, world, bodies)
    return Samples(scene, *kinds) if any(kinds) else None


def _through_smooth(scene, world, bodies):
    """`Lamps` and `Wide`."""
    shapes = {shape.id(): shape for shape in world.scene.shapes()}
    smooth = {number: shapes[body.name] for number, body in bodies.items() if _smooth(shapes[body.name])}
    if not smooth:
        return None, None
    blind, names = any(body.matched for body in bodies.values()), {body.name for body in bodies.values()}
    panes = [shape for name, shape in shapes.items() if name not in names and _smooth(shape)]
    alone = not (blind or scene.regions.bounded or scene.regions.always)
    if not alone:  # what is between panes would have to be known
        panes = []
    boundaries = list(smooth.values())
    sky = Sky(scene) if scene.scene.environment() is not None and not scene.regions.always else None
    widest = solid_angles.WIDEST_BEHIND_PANES if panes else solid_angles.WIDEST if alone else solid_angles.WIDEST_ALONE
    drawn = solid_angles.drawn(scene, boundaries, panes, sky, widest)
    least = {number: float(min(bodies[number].medium.sigma_t)) * world.unit for number in smooth}
    around = {shape: solid_angles.index_around(scene, shape, panes, drawn) for shape in boundaries} if panes else {}
    manifold = Manifold(scene.scene, scene.boundaries, {shape: least[number] for number, shape in smooth.items()}, blind,
                        around, panes)
    sigma = [least.get(number, 0.0) for number in range(len(scene.entries))]
    small = Lamps(scene, manifold, drawn, sigma, not blind and not scene.regions.bounded, bool(panes)) if drawn else None
    if not alone:
        return small, None
    by_directions = _others(scene, manifold, sigma, {}) if small and small.success() < _SUCCESS else None
    return (None, by_directions) if by_directions else (small, _others(scene, manifold, sigma, drawn))


def _through_rough(scene, world, bodies):
    """`Rough`, None where light comes from nearly everywhere, or not at all."""
    shapes = {shape.id(): shape for shape in world.scene.shapes()}
    rough = {number: shapes[body.name] for number, body in bodies.items() if _rough(shapes[body.name])}
    if not rough:
        return None
    least = {number: float(min(bodies[number].medium.sigma_t)) * world.unit for number in rough}
    manifold = Manifold(scene.scene, scene.boundaries, {shape: least[number] for number, shape in rough.items()}, False)
    lights = Rough(scene, manifold, [least.get(number, 0.0) for number in range(len(scene.entries))], list(rough.values()))
    return lights if lights.guides.contrast > _CONTRAST_OF_ROUGH else None


def _others(scene, manifold, sigma, drawn):
    """`Wide` of lights that are not drawn as lamps; None where they shine from nearly everywhere, or not at all."""
    counts = _Others(scene.scene, [lamp.emitter if isinstance(lamp, Sky) else lamp.emitter() for lamp in drawn])
    guides = Guides(scene, manifold, sigma, ways(scene, counts), blur=BLUR)
    worth = guides.share > _SHARE and guides.contrast > _CONTRAST
    return Wide(scene, guides, sigma, counts) if worth else None


class _Others:
    """Whether emitters are others than some."""

    def __init__(self, scene, emitters):
        every = scene.emitters()
        self._table = mi.UInt32(by_number([*every, *emitters], [1] * len(every) + [0] * len(emitters)))

    def __call__(self, emitter):
        return dr.gather(mi.UInt32, self._table, dr.reinterpret_array(mi.UInt32, emitter)) > 0


def _rough(shape):
    """Whether a shape is a mesh whose boundary refracts, but in no single direction."""
    return shape.is_mesh() and not shape.has_flipped_normals() and shape.bsdf().class_name() == "RoughDielectric"


def _smooth(shape):
    """Whether a shape is a mesh whose boundary does nothing but refract and reflect all light."""
    return shape.is_mesh() and not shape.has_flipped_normals() and shape.bsdf().class_name() == "SmoothDielectric" \
        and list(mi.traverse(shape.bsdf()).keys()) == ["eta"]
