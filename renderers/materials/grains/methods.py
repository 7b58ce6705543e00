"""The methods of a scene: which passes make its picture, and what is to be said of them."""

from functools import partial
from typing import NamedTuple

import numpy as np

from renderers.materials.grains import bundles, far, local, material, medium, transport
from renderers.materials.grains.declared import methods
from renderers.materials.grains.declared.ept import LITTLE, smooth
from renderers.materials.grains.transport import GRAINS, MEDIUM, Body, Transport
from renderers.mitsuba import lights
from renderers.pictures.engine import Part, layers_of
from renderers.pictures.passes import Method
from renderers.scene import budget
from renderers.scene.budget import percent
from renderers.scene.declaration import settled
from renderers.transport import regularised
from renderers.transport.paths import Colours
from renderers.transport.scattering import Scatterer

_TECHNIQUES = ("ept", "vpt", "da")
_MOST = 32  # media of the loop: `renderers.transport.scene.MOST`, which cannot be imported before Mitsuba is there
_PATHS = 1 << 16  # of a pass, at most, where a pixel has several: those that go on together
_SAMPLES = 16  # a pixel and pass, at most: the noise of small pictures is known from several passes
# Of the paths, that go on to their end in passes of a short render after the switch, where they take five times as long
_FEWEST = 1 / 4
# From grain to grain, where a pass meets so many grains, some seconds of a processor: of renders with so much of the time that
# whole passes need, and of those with less, which share of the paths goes on after how many grains.  Half after 2 in place of 4
# take 0.90 of the time of a pass of the spices, with 1.13 times the variance; three in eight after 3 0.76, with 1.40 times.  A
# quarter after 1 in place of half after 2 takes 0.70, with 2.3 times; a sixth after 2 0.82 of that, with 1.25 times, an eighth
# 0.77, with 1.66 times.  FLIP of the denoised draft from ten passes of all paths, 320 x 240, 0.122 with a quarter, with half
# 0.113, with all paths 0.110
_GRAINS, _LONGER, _HALF, _SIXTH = 1 << 20, 1 / 8, (1 / 2, 2), (1 / 6, 2)


def prepare(job, world, seed) -> Method:
    """The method that a scene asks for; `job` is a `renderers.pictures.running.Render`, `world` the surfaces and lights
    around."""
    values, assets, meshes = job.scene.values, job.assets, material.meshes_of(job.scene)
    lights.favour(world, np.concatenate([vertices for vertices, _ in meshes]))
    if any(not np.array_equal(asset.wavelength, assets[0].wavelength) for asset in assets):
        raise job.scene.wrong("materials", "the assets have different wavelengths; assets of the same ones would do")
    varies = [local.local_of(job.scene, body, asset, material.fraction_of(asset), vertices)
              for body, (asset, (vertices, _)) in enumerate(zip(assets, meshes))]
    filled = ((asset.content_hash, vertices.tobytes()) for asset, (vertices, _) in zip(assets, meshes))
    grains = world.once(("grains", *filled), lambda: [
        material.grains_of(asset, *mesh, varied) for asset, mesh, varied in zip(assets, meshes, varies)])
    material.refuse_overlap(job.scene, range(len(grains)), grains, meshes)
    tolerance, surfaces = values.tolerance or budget.DEFAULT, (None, [])
    if methods()[values.method].surface_far:
        surfaces = far.surfaces_of(job.scene, world, assets, grains, meshes, methods()[values.method])
    asked = Asked(values.materials[0].spread, values.materials[0].widen)
    return of(values.method, world, assets, meshes, grains, seed, asked, tolerance, surfaces)


class Asked(NamedTuple):
    """What a scene says of methods: `spread` and `widen`, as there."""

    spread: float = 4.0
    widen: float | None = None


PLAIN = Asked()


def of(name, world, assets, meshes, grains, seed, asked=PLAIN, tolerance=budget.DEFAULT, surfaces=(None, ())) -> Method:
    """The method of a name, which is another where that chooses.

    assets, meshes, grains : of the bodies, in their order; meshes of vertices (V, 3) m and triangles (F, 3)
    asked : `Asked`;  tolerance : as in a scene
    surfaces : `transport.Transport.surfaces`, and sentences about them
    """
    name = settled(methods(), name)
    declared = methods()[name]
    # with the grains, whose places in memory nothing else has then
    scene, reasons, _ = world.once(("transport", name, asked, *map(id, grains)), lambda: (
        *transport_of(name, world, assets, meshes, grains, asked), grains))
    scene, reasons = scene._replace(surfaces=surfaces[0]), [*reasons, *surfaces[1]]
    if stated := declared.error(tolerance):
        reasons.append(f"how far {name} is off is not measured: in the scenes of docs/granular.md by up to {percent(stated)}")
        if declared.switches and any(map(material.opaque, assets)):
            reasons.append("of opaque grains it leaves more light out, 2 to 10 % (docs/granular.md): the medium is darker than "
                           "they are")
    if scene.switch is not None and declared.diffuses and any(body.medium.varies for body in scene.bodies):
        reasons.append("no light diffuses in bodies whose fraction or mixture varies")
    numbers = [material.number_in(packed, *mesh) for packed, mesh in zip(grains, meshes)]
    reasons += material.of_number(min(numbers))
    # Light before the switch and after it by paths of their own: each gets the passes that take most variance away in their time.
    # Ending some paths by chance at the switch (section 5 of the paper) adds the variance of that chance.
    kinds = [(name, transport.ALL)] if scene.switch is None else [("grains", transport.BEFORE), ("medium", transport.AFTER)]
    # when paths switch depends on how close the pixels of a bundle are: pilots of all methods look through the same pixels
    view = bundles.as_close(world)
    loop = medium_part(scene.bodies, meshes, scene.colours, view, seed) if scene.technique == MEDIUM else None
    meetings = max(material.meetings(asset, *mesh) for asset, mesh in zip(assets, meshes))
    parts = (loop,) if loop else tuple(part(view, scene, kind, seed, which, meetings=meetings) for kind, which in kinds)

    left_out = world.left_out()
    reasons += left_out
    seen = [remembering(scene.interactor(body, scene.technique).seen) for body in range(len(scene.bodies))]

    def entry(*rays):
        return np.min([of_body(*rays)[0] for of_body in seen], axis=0)

    def after(estimate):
        return {"grains": sum(numbers), "layers": _switches(estimate.means.values()), "bias": None, "left_out": left_out}

    return Method(name, parts, reasons, after,
                  features=lambda quality: _features(world, scene, assets, meshes, seed, quality, seen),
                  apart=(kinds[0][0],) if scene.technique == GRAINS else (), entry=entry)


def remembering(seen):
    """A function of arrays that gives what it gave last where it is asked for the same: layer `depth.Z` and the filter of a draft
    both ask what rays through the middles of the pixels meet."""
    asked, told = [], []

    def again(*rays):
        if not (asked and all(map(np.array_equal, asked, rays))):
            asked[:], told[:] = rays, seen(*rays)
        return told

    return again


def cone(declared, widen, world, assets, meshes):
    """Half angle, rad, of the cone in which smooth grains show small lamps; 0 where they show them as they are."""
    if not (declared.widens and smooth(assets) and world.small_share > LITTLE):
        return 0.0
    if widen is not None:
        return widen
    view = world.whole or world
    return regularised.angle_of(max(material.pixels_wide(view, vertices[faces], material.largest_of(asset))
                             for asset, (vertices, faces) in zip(assets, meshes)))


def _features(*scene):
    from renderers.materials.grains import features

    return features.first_hits(*scene)


def transport_of(name, world, assets, meshes, grains, asked=PLAIN):
    """How light goes by a method, a `Transport`, and sentences about it; parameters as those of `of`."""
    declared = methods()[name]
    colours, reasons, bodies = Colours.of(assets[0].wavelength), [], []
    reach = [material.radius_of(packed) for packed in grains]
    for number, (asset, packed) in enumerate(zip(assets, grains)):
        others = [(*mesh, reach[other_body]) for other_body, mesh in enumerate(meshes) if other_body != number]
        around = material.occupied_by(world, packed.aggregate, packed.unit, others), colours
        ways = declared.grains(packed, *around), None
        if declared.medium:
            stands, varied, met_by = material.medium_of(asset, packed)
            ways = ways[0], medium.Continuous(stands, *around, declared.diffuses, varied, met_by)
        bodies.append(Body(*ways, reach[number]))
    angle = cone(declared, asked.widen, world, assets, meshes)
    for asset in assets:
        reasons += material.reasons_of_medium(asset) if declared.continuous else material.reasons_of(asset, angle)
    switch = asked.spread if declared.switches else None
    start = MEDIUM if declared.continuous else GRAINS
    leaves_out = [] if declared.surface_far else filter(None, [declared.leaves_out])  # of which parts `far` tells
    return Transport(tuple(bodies), colours, start, switch, angle=angle), list(dict.fromkeys([*leaves_out, *reasons]))


def medium_part(bodies, meshes, colours, world, seed):
    """Passes of paths through the media that stand for grains, by the loop of `renderers.transport`.

    None where fraction or mixture vary in a body: its extinction there is no multiple of that at one fraction, and its phase
    function another.

    bodies : of a `Transport`;  meshes, colours, world, seed : as those of `of`
    """
    if len(bodies) > _MOST or any(body.medium.varies for body in bodies):
        return None
    from renderers.transport import passes, regions

    entries = []
    for body, mesh in zip(bodies, meshes):
        stands = body.medium.medium
        scatterer = Scatterer(stands.sigma_t / stands.unit, stands.albedo, stands.v, stands.steps, stands.phase, stands.cdf)
        entries.append(regions.Medium(regions.Mesh(*mesh), scatterer))
    return passes.part("vpt", world, entries, colours, seed, by_light=True)


def part(world, scene, name, seed, which=transport.ALL, samples=None, meetings=0.0) -> Part:
    """Passes by a `Transport`, with layers of orders, lights and techniques.

    Paths from grain to grain alone go through shapes of a Mitsuba scene where the grains are few enough (`shapes`), else in
    wavefronts.  Small pictures have several samples a pass: each call of Mitsuba's takes a ms of its own, for however few paths.

    samples : of a pixel, in a pass; below 1: of the time that it needs with all of its long paths; None: as many as go together
    meetings : grains that light meets on average
    """
    height, width = world.size
    if scene.switch is None and scene.technique == GRAINS:
        from renderers.materials.grains import shapes

        if shapes.fit(world, [body.grains for body in scene.bodies]):
            return shapes.part(name, world, [body.grains.grains for body in scene.bodies], scene.colours, seed, scene.angle)
    fewer = partial(part, world, scene, name, seed, which, meetings=meetings)
    samples = samples or 1 << max(0, min(_SAMPLES, _PATHS // (height * width)).bit_length() - 1)
    if samples < 1:
        share, late = (samples, 1) if which == transport.AFTER else _HALF if samples >= _LONGER else _SIXTH
        scene, samples = scene._replace(share=share, late=late), 1

    def one(number):
        begins = scene._replace(chord=regularised.chord(scene.angle, samples * (number + 1)))
        sums = transport.one_pass(world, begins, world.camera, world.size, number, seed, which, world.corners, samples)
        return _layers(sums, world, scene)

    long = scene.switch is None and meetings * height * width > _GRAINS
    return Part(name, one, samples, fewer, fewest=_FEWEST if which == transport.AFTER else _LONGER / 2 if long else 1)


def _layers(sums, world, scene):
    """Layers of a pass by name, as `Part` takes them."""
    height, width = world.size
    images = layers_of(sums.by_order, sums.by_light, world.light_names)
    if scene.switch is not None:
        images |= {SWITCHED: sums.switched}
        images |= {name: image for name, image in zip(_TECHNIQUES, sums.by_technique) if image.any()}
    return {name: image.reshape(height, width, 3) for name, image in images.items()}


SWITCHED = "switched"  # layer: grains met before the switch, and whether there was one


def _switches(means) -> dict:
    """Layer `switch` (H, W), grains that paths have met when they switch, on average, 0 where none does; of means of passes."""
    switched = sum(mean.count * mean.layers[SWITCHED].astype(float) for mean in means if SWITCHED in mean.layers)
    return {} if np.ndim(switched) == 0 else {"switch": switched[..., 0] / np.maximum(switched[..., 1], 1e-30)}
