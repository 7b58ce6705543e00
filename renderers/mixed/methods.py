"""How a scene of several materials is rendered: by one loop of Dr.Jit where all of it is continuous, else by wavefronts."""

from functools import partial

import numpy as np

from renderers.materials.bodies.bodies import flaws, rounded
from renderers.materials.grains import material
from renderers.materials.grains.paths import first_grain, seen_grain
from renderers.materials.particles.interactor import seen_particle
from renderers.mixed import build, contents, surfaces
from renderers.mixed import passes as wavefronts
from renderers.mixed.scene import chosen
from renderers.mixed.spectra import BANDS, Spectra
from renderers.pictures.passes import Method
from renderers.scene.entries import declared
from renderers.transport import regions

MOST_IN_A_LOOP = 32  # media: more than that go through wavefronts (`renderers.transport.scene.MOST`)
_MATERIAL = 16  # paths of a pixel that layer `material` is made of where no pass counts them


def prepare(job, world, seed) -> Method:
    """The method of a scene; `job` is a `renderers.pictures.running.Render`, `world` the surfaces and lights around."""
    scene, assets = job.scene, job.assets
    placed = surfaces.put(scene, world, assets)
    changing = surfaces.changing(scene, world, assets, placed)
    inside = [number for number in range(len(assets)) if number not in placed]  # entries that paths go into
    spectra = Spectra.of([assets[number] for number in inside])
    filled = [contents.Content(None, None, placed[number]) if number in placed
              else contents.of(scene, world, asset, spectra, number) for number, asset in enumerate(assets)]
    filled = contents.shown_alike(filled, assets)
    filled = [content._replace(reasons=(*content.reasons, *changing[number].reasons)) if number in changing else content
              for number, content in enumerate(filled)]
    _refuse_overlap(scene, filled)
    _refuse_twins(scene, filled)
    reasons = [BANDS] * spectra.bands + [reason for content in filled for reason in content.reasons]
    materials = [filled[number].what for number in inside]
    explicit = [number for number, content in enumerate(materials) if isinstance(content, contents.Particles | contents.Grains)]
    bodies = [content for content in materials if isinstance(content, contents.Body)]
    looped = not explicit and len(materials) <= MOST_IN_A_LOOP
    matched = {body.name for body in bodies if body.matched}  # light samples go through these
    left_out = world.left_out(matched) + (rounded(bodies) if looped else [])
    reasons += (faults := left_out + flaws(world, bodies))
    entries = [chosen(entry.kind, entry.method) for entry in scene.values.materials]
    stated = [declared(entry.kind)[name] for entry, name in zip(scene.values.materials, entries, strict=True)]
    widened = [getattr(content.what, "angle", 0.0) for content in filled]
    # nor is what is explicit without bias where smooth grains are to show lamps that no path meets
    stand_ins = [method.continuous or method.surface or method.surface_far or angle > 0
                 or method.exact and method.lacks([asset], world) != ""
                 for method, angle, asset in zip(stated, widened, assets, strict=True)]
    listed = [{"kind": entry.kind, "method": name, "bias": None if stand_in else 0.0, "reasons": list(content.reasons),
               "pilot": None}
              for entry, name, stand_in, content in zip(scene.values.materials, entries, stand_ins, filled, strict=True)]
    exact, unmeasured = not (spectra.bands or any(stand_ins) or faults), bool(spectra.bands or faults)
    figures = {"materials": listed, "bias": 0.0 if exact else None, "left_out": left_out}
    name = " and ".join(dict.fromkeys(entries))
    far = {inside.index(number): entry.far for number, entry in changing.items() if entry.far}
    if looped:
        method = _in_one_loop(name, world, materials, spectra.colours, seed, reasons, figures, inside, far)
        return method._replace(unmeasured=unmeasured)
    if far:
        number = inside[next(iter(far))]
        raise scene.wrong(f"materials[{number}].method", f"found {entries[number]} beside particles or grains, or more than "
                          f"{MOST_IN_A_LOOP - 1} media; use paths or surface, or a medium for the others")
    around = build.scene_of(world, [build.material_of(content) for content in materials], spectra.colours,
                            max(widened, default=0.0))
    part, shares = wavefronts.part("paths", around, seed), []

    def after(estimate):
        shares.append(wavefronts.first_shares(estimate.means.values()))
        return figures | {"layers": {"material": _of_entries(wavefronts.material_layer(shares[0]), inside)}}

    def features(quality):
        # what is told apart looks like noise: there the network does not see the picture
        seen = _features(world, [filled[number].stands for number in inside], spectra.colours, seed)
        seen = _with_grains(world, [filled[inside[number]] for number in explicit], spectra.colours, seen, quality)
        particles = [number for number in explicit if isinstance(materials[number], contents.Particles)]
        return seen._replace(detail=np.minimum(seen.detail + shares[0][..., particles].sum(axis=-1), 1.0))

    return Method(name, (part,), reasons, after, features=features if len(materials) <= MOST_IN_A_LOOP else None,
                  apart=("paths",) if explicit else (), entry=_entry(materials), unmeasured=unmeasured)


def _entry(materials):
    """Distances to the first grain of all materials, as `renderers.mitsuba.world.World.depth` takes them."""
    packed = [content.grains for content in materials if isinstance(content, contents.Grains)]

    def entry(origin, direction, far):
        return np.min([first_grain(grains, origin, direction, far) for grains in packed], axis=0)

    return entry if packed else None


def _features(world, entries, colours, seed):
    from renderers.transport import features

    return features.first_hits(world, entries, colours, seed)


def _with_grains(world, explicit, colours, around, quality):
    """Features for a quality with those of grains and particles, `contents.Content`, in place of what stands for them."""
    from renderers.materials.grains import features

    bodies = [features.with_radius(partial(seen_grain, content.what.grains), material.radius_of(content.what.grains))
              if isinstance(content.what, contents.Grains) else partial(_wide_particle, world, content.what.medium)
              for content in explicit]
    albedo = features.albedos([content.stands for content in explicit], colours)
    return features.of_grains(world, bodies, albedo, around, features.places_for(quality))


def _wide_particle(world, medium, origin, direction, far):
    """As `seen_particle`, of the camera's rays through all pixels, where it is as wide as a pixel or more."""
    distance, normal, radius = seen_particle(medium, origin, direction, far)
    narrow = 2 * radius < world.camera.angle(*world.size).ravel() * distance
    distance[narrow], normal[narrow], radius[narrow] = np.inf, 0.0, 0.0
    return distance, normal, radius


def _of_entries(layer, inside):
    """Layer `material` by the numbers of entries."""
    return np.append(np.asarray(inside, int), -1)[np.asarray(layer).astype(int)].astype("float32")


def _in_one_loop(name, world, materials, colours, seed, reasons, figures, inside, far):
    from renderers.transport import passes

    part = passes.part("paths" if materials else "surfaces", world, materials, colours, seed, by_light=True, far=far)
    if not materials:
        return Method(name, (part,), reasons, lambda estimate: figures)

    def after(estimate):
        numbers = passes.materials(world, materials, colours, seed, _MATERIAL)
        return figures | {"layers": {"material": _of_entries(numbers, inside)}}

    return Method(name, (part,), reasons, after, features=lambda quality: _features(world, materials, colours, seed))


def _refuse_overlap(scene, filled):
    """UsageError where grains of one entry reach into the mesh of another's."""
    packed = {number: content.what for number, content in enumerate(filled) if isinstance(content.what, contents.Grains)}
    grains, meshes = ([getattr(content, name) for content in packed.values()] for name in ("grains", "region"))
    material.refuse_overlap(scene, packed, grains, meshes)


def _refuse_twins(scene, filled):
    """UsageError where a box, or a grid's, or a mesh is that of an entry before: nobody could say which is the innermost."""
    before: list[tuple[int, str, np.ndarray]] = []
    for number, content in enumerate(filled):
        region = getattr(content.stands, "region", None)
        if isinstance(region, regions.Mesh):
            kind, corners = "mesh", region.vertices
        elif hasattr(region, "lo"):
            kind, corners = "box", np.array([region.lo, region.hi], float)
        else:
            continue
        for earlier, of_kind, others in before:
            if kind == of_kind and corners.shape == others.shape and \
                    np.allclose(corners, others, rtol=0, atol=1e-9 * float(np.ptp(others, axis=0).max())):
                raise scene.wrong(f"materials[{number}].where", f"found the {kind} of materials[{earlier}], so that neither is "
                                  "inside of the other; use a larger or a smaller one")
        before.append((number, kind, corners))
