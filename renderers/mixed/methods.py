"""How a scene of several materials is rendered: by one loop of Dr.Jit where all of it is continuous, else by wavefronts."""

from __future__ import annotations

from renderers.mixed import build, contents
from renderers.mixed import passes as wavefronts
from renderers.mixed.scene import STAND_INS, chosen
from renderers.mixed.spectra import BANDS, Spectra
from renderers.passes import Method

_MATERIAL = 16  # paths of a pixel that layer `material` is made of where no pass counts them


def prepare(job, world, seed) -> Method:
    """The method of a scene; `job` is a `renderers.running.Render`, `world` the surfaces and lights around."""
    scene, assets = job.scene, job.assets
    spectra = Spectra.of(assets)
    found = [contents.of(scene, world, asset, spectra, number) for number, asset in enumerate(assets)]
    _refuse_overlap(scene, found)
    reasons = [BANDS] * spectra.bands + [reason for one in found for reason in one.reasons]
    entries = [chosen(entry.kind, entry.method) for entry in scene.values.materials]
    listed = [{"kind": entry.kind, "method": name, "bias": None if name in STAND_INS else 0.0, "reasons": list(one.reasons),
               "pilot": None} for entry, name, one in zip(scene.values.materials, entries, found, strict=True)]
    exact = not spectra.bands and not set(entries) & set(STAND_INS)
    figures = {"materials": listed, "bias": 0.0 if exact else None}
    name = " and ".join(dict.fromkeys(entries))
    what = [one.what for one in found]
    if not any(isinstance(one, contents.Particles | contents.Grains) for one in what):
        return _in_one_loop(name, world, what, spectra.colours, seed, reasons, figures)
    room = build.scene_of(world, [build.material_of(one) for one in what], spectra.colours)
    part = wavefronts.part("paths", room, seed)
    return Method(name, (part,), reasons,
                  lambda estimate: figures | {"layers": {"material": wavefronts.material_layer(estimate.means.values())}})


def _in_one_loop(name, world, what, colours, seed, reasons, figures):
    from renderers.transport import passes

    part = passes.part("paths", world, what, colours, seed, by_light=True)

    def after(estimate):
        return figures | {"layers": {"material": passes.materials(world, what, colours, seed, _MATERIAL).astype("float32")}}

    return Method(name, (part,), reasons, after)


def _refuse_overlap(scene, found):
    """UsageError where grains of one entry reach into the mesh of another's by more than a radius."""
    from renderers.granular import material

    numbers = [number for number, one in enumerate(found) if isinstance(one.what, contents.Grains)]
    packed = [found[number].what for number in numbers]
    if both := material.overlap([one.grains for one in packed], [tuple(one.region) for one in packed]):
        outer, inner, deep = both
        raise scene.wrong(f"materials[{numbers[inner]}].where.mesh", f"reaches {deep:.2g} m into the mesh of "
                          f"materials[{numbers[outer]}]; meshes that do not overlap, but may touch, would do")
