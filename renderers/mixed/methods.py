"""How a scene of several materials is rendered: by one loop of Dr.Jit where all of it is continuous, else by wavefronts."""

from __future__ import annotations

import numpy as np

from renderers.materials.grains.paths import first_grain
from renderers.mixed import build, contents
from renderers.mixed import passes as wavefronts
from renderers.mixed.scene import chosen
from renderers.mixed.spectra import BANDS, Spectra
from renderers.pictures.passes import Method
from renderers.scene.entries import declared

MOST_IN_A_LOOP = 32  # media: more than that go through wavefronts (`renderers.transport.scene.MOST`)
_MATERIAL = 16  # paths of a pixel that layer `material` is made of where no pass counts them


def prepare(job, world, seed) -> Method:
    """The method of a scene; `job` is a `renderers.pictures.running.Render`, `world` the surfaces and lights around."""
    scene, assets = job.scene, job.assets
    spectra = Spectra.of(assets)
    found = [contents.of(scene, world, asset, spectra, number) for number, asset in enumerate(assets)]
    _refuse_overlap(scene, found)
    _refuse_twins(scene, found)
    reasons = [BANDS] * spectra.bands + [reason for one in found for reason in one.reasons]
    entries = [chosen(entry.kind, entry.method) for entry in scene.values.materials]
    stand_ins = [declared(entry.kind)[name].continuous for entry, name in zip(scene.values.materials, entries, strict=True)]
    listed = [{"kind": entry.kind, "method": name, "bias": None if stand_in else 0.0, "reasons": list(one.reasons),
               "pilot": None}
              for entry, name, stand_in, one in zip(scene.values.materials, entries, stand_ins, found, strict=True)]
    exact = not spectra.bands and not any(stand_ins)
    figures = {"materials": listed, "bias": 0.0 if exact else None}
    name = " and ".join(dict.fromkeys(entries))
    what = [one.what for one in found]
    explicit = [number for number, one in enumerate(what) if isinstance(one, contents.Particles | contents.Grains)]
    if not explicit and len(what) <= MOST_IN_A_LOOP:
        return _in_one_loop(name, world, what, spectra.colours, seed, reasons, figures)
    room = build.scene_of(world, [build.material_of(one) for one in what], spectra.colours)
    part, shares = wavefronts.part("paths", room, seed), []

    def after(estimate):
        shares.append(wavefronts.first_shares(estimate.means.values()))
        return figures | {"layers": {"material": wavefronts.material_layer(shares[0])}}

    def features():
        # what is told apart looks like noise: there the picture stays as it is
        return _features(world, [one.stands for one in found], spectra.colours, seed)._replace(
            detail=shares[0][..., explicit].sum(axis=-1))

    seen = features if len(what) <= MOST_IN_A_LOOP else None
    return Method(name, (part,), reasons, after, features=seen, apart=("paths",) if explicit else (), entry=_entry(what))


def _entry(materials):
    """Distances to the first grain of all materials, as `renderers.mitsuba.world.World.depth` takes them."""
    packed = [content.grains for content in materials if isinstance(content, contents.Grains)]

    def entry(origin, direction, far):
        return np.min([first_grain(grains, origin, direction, far) for grains in packed], axis=0)

    return entry if packed else None


def _features(world, entries, colours, seed):
    from renderers.transport import features

    return features.first_hits(world, entries, colours, seed)


def _in_one_loop(name, world, what, colours, seed, reasons, figures):
    from renderers.transport import passes

    part = passes.part("paths", world, what, colours, seed, by_light=True)

    def after(estimate):
        return figures | {"layers": {"material": passes.materials(world, what, colours, seed, _MATERIAL).astype("float32")}}

    return Method(name, (part,), reasons, after, features=lambda: _features(world, what, colours, seed))


def _refuse_twins(scene, found):
    """UsageError where a box, or a grid's, is that of an entry before: which of them is the innermost nobody could say."""
    boxes: list[tuple[int, np.ndarray]] = []
    for number, one in enumerate(found):
        region = getattr(one.what, "region", None)
        if not hasattr(region, "lo") or hasattr(region, "nodes") and region.nodes.size > 1:
            continue
        box = np.array([region.lo, region.hi], float)
        for other, known in boxes:
            if np.allclose(box, known, rtol=0, atol=1e-9 * float(np.ptp(known, axis=0).max())):
                raise scene.wrong(f"materials[{number}].where", f"found the box of materials[{other}], so that neither is inside "
                                  "of the other; a larger or a smaller one would do")
        boxes.append((number, box))


def _refuse_overlap(scene, found):
    """UsageError where grains of one entry reach into the mesh of another's by more than a radius."""
    from renderers.materials.grains import material

    numbers = [number for number, one in enumerate(found) if isinstance(one.what, contents.Grains)]
    packed = [found[number].what for number in numbers]
    if both := material.overlap([one.grains for one in packed], [tuple(one.region) for one in packed]):
        outer, inner, deep = both
        raise scene.wrong(f"materials[{numbers[inner]}].where.mesh", f"reaches {deep:.2g} m into the mesh of "
                          f"materials[{numbers[outer]}]; meshes that do not overlap, but may touch, would do")
