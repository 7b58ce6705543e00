"""The methods of a scene: which passes make its picture, and what is to be said of them."""

from __future__ import annotations

import math

import numpy as np

from bakery import kernels
from renderers import colour
from renderers.passes import Method
from renderers.progressive import Part
from renderers.translucent import beams, dipole, light, refraction, shells, smooth, thin, transport
from renderers.translucent.bodies import Body, has_tables, holds, laid_out, medium_of, untabled
from renderers.translucent.scene import READERS, index_fault
from renderers.translucent.thin import WALKS
from renderers.translucent.transport import UNLIMITED, Colours, Gather, Transport

EACH_EVENT = ("paths", "shells")  # methods that have no beams
ENTRIES, PICKS, _LEAST, _ALONE = 16384, 64, 4, 32
_LIT = 1 << 15  # places on each boundary where beams begin that lines of sight meet
TABLED = ("vrl+tables", "beams+tables")  # that take later events from the tables
JOINED = ("beams+tables", "beams")  # that join beams with lines of sight where they pass close by
_FIRST = 8192  # places that tell where light comes into a body
_LATER = 1 << 31  # passes of lines of sight that gather beams are numbered from here
_BESIDE = 3 << 30  # and of those that meet beams
CLOSER = "closer"  # layer: what sharing over half the distance changes
_MOST = 31  # bodies of which one loop keeps in which a path is
_BEYOND = 1e-3  # share of the light beyond the tables that is worth a word
_LAYERS = ("order0", "order1", "order2", "orders")


def prepare(job, world, seed) -> Method:
    """The method that a scene asks for; `job` is a `renderers.running.Render`, `world` the surfaces and lights around."""
    settings, assets = job.scene.values.translucent, job.assets
    if any(not np.array_equal(one.wavelength, assets[0].wavelength) for one in assets):
        raise job.scene.wrong("translucent.bodies", "the assets have different wavelengths; assets of the same ones would do")
    entries = settings.bodies
    how = transport_of(world, [one.shape for one in entries], assets, [one.boundary and one.boundary.index for one in entries],
                       lambda number, key, message: job.scene.wrong(f"translucent.bodies[{number}].{key}", message),
                       settings.method)
    name, made = of(how, settings.method, settings.boundary, seed)
    said = _reasons(assets, how.bodies, settings.method, name) + (shells.reasons(shells.laid(how)) if name == "shells" else [])
    # how far off dipole is nobody states; what sharing between pixels adds to that would pass for all of it
    return Method(name, made, said,
                  lambda estimate: {"bias": None if name == "dipole" else _bias(estimate.means.values(), estimate.rgb)})


def of(how, name, boundary, seed):
    """The method of a name, with what `auto` stands for, and its parts; parameters as those of `parts`."""
    if name == "auto":
        wide = all(thin.sparse(body.vertices, body.faces, smooth.reduced(body.medium)) for body in how.bodies)
        name = "shells" if wide else "vrl+tables" if all(body.tables for body in how.bodies) else "paths"
    return name, parts(shells.laid(how) if name == "shells" else how, name, boundary, seed)


def transport_of(world, names, assets, indices, wrong, name="vrl+tables") -> Transport:
    """How light goes in a scene.

    names : of the shapes that are bodies;  assets : of each;  indices : refractive index of each, or None
    wrong : function of (number of a body, what of it, message) -> the exception to raise where something is wrong
    name : of the method; assets have to hold the tables that it looks up
    """
    shapes = world.shapes()
    bodies = [_body(shapes, *one, lambda key, message, number=number: wrong(number, key, message),
                    name if not world.dark or name != "auto" else "paths")
              for number, one in enumerate(zip(names, assets, indices, strict=True))]
    bodies, geometry = laid_out(world, bodies, wrong)
    waves = np.asarray(assets[0].wavelength, float)
    colours = Colours(np.ascontiguousarray(colour.srgb_matrix(waves)), np.ascontiguousarray(colour.spread_matrix(waves)))
    panes = any(shape.index is not None and shape.smooth and shape.name not in names for shape in shapes)
    return Transport(world, bodies, geometry, colours, [refraction.bent(world, body, shapes) for body in bodies], panes=panes)


def _body(shapes, name, asset, index, wrong, method):
    """The body that a shape is."""
    found = [shape for shape in shapes if shape.name == name]
    if len(found) != 1:
        names = ", ".join(sorted(shape.name for shape in shapes)) or "none"
        raise wrong("shape", f"found {name!r}; expected the id of a shape of the Mitsuba scene: {names}")
    shape = found[0]
    if shape.faces is None:
        raise wrong("shape", f"{name} is no mesh; a closed mesh would do")
    try:
        vertices, faces = kernels.solid(shape.vertices, shape.faces)
    except ValueError as fault:
        raise wrong("shape", f"{name} is no closed mesh: {fault}") from None
    if shape.index is None:
        raise wrong("shape", f"the BSDF of {name} lets no light in; dielectric, roughdielectric or null would do")
    if fault := index_fault(name, index, shape.index):
        raise wrong("boundary.index", fault)
    medium = medium_of(asset) if has_tables(asset) else untabled(asset)
    few = np.max(thin.later(thin.chord(vertices, faces) * medium.sigma_t, medium.albedo, shape.index)) <= thin.FEW
    tabled = has_tables(asset) or method in READERS \
        or method == "auto" and not few and not thin.sparse(vertices, faces, smooth.reduced(medium))
    if tabled and not hasattr(asset.multiple, "segment"):
        raise wrong("asset", "its stage multiple holds no tables of segments; multiple_scattering: {sources: [point, segment]} "
                             "in its recipe would do")
    tables = [(points, segments) for points, segments, _ in asset.multiple.segment.tables()] if tabled else []
    return Body(name, vertices, faces, shape.index, shape.smooth, medium, tables, False, shells.none(len(medium.sigma_t)))


def parts(how, name, boundary, seed, places=ENTRIES, walks=WALKS, picks=PICKS):
    """The parts of a method, as `renderers.progressive` takes them.

    how : `transport.Transport`;  name, boundary : method and boundary as a scene names them
    places, walks : places where light comes in, and walks
    picks : beams that are drawn for a place of a body: by all lines of sight together that share their light, `_LEAST` by each;
        with tables `_ALONE` by those that do not
    """
    height, width = how.world.size
    tabled = name in TABLED
    # second events: paths find lights in them, but for lights that no ray can meet, through boundaries that turn light
    second = [name in ("vrl", "dipole", "beams") or name != "beams+tables" and how.world.without_extent and not body.matched
              for body in how.bodies]
    if name in JOINED:
        # they bring lights without extent, too
        how = how._replace(bent=[[] for _ in how.bodies])
    most = [UNLIMITED if name in EACH_EVENT else 1 if joins else 2 for joins in second]

    entries, lines = [], []

    def images(sums):
        by_order = [image.reshape(height, width, 3) for image in sums.by_order]
        return {"": sum(by_order)} | dict(zip(_LAYERS, by_order))

    def known():
        if not entries:
            entries.extend(light.entries_of(how, body, _FIRST, seed) for body in range(len(how.bodies)))
        return entries

    def seen(number):
        return smooth.seen(how, transport.begin(how, np.arange(height * width), number, seed))

    def chosen(what, number):
        """Pixels that gather; all where what they find is not shared."""
        return np.ones((height, width), bool) if any(second) else smooth.chosen(what, number)

    def fewer():
        """Beams of a line of sight that shares what it gathers, in each body."""
        if not lines:
            what = seen(_LATER)
            lines.extend(min(max(math.ceil(picks / one), _LEAST), _ALONE)
                         for one in smooth.sharing(what, chosen(what, 0), len(how.bodies)))
        return lines

    def rivals():
        return beams.rivals_of(how, known(), _LIT)

    def found(number):
        sums = transport.from_eye(how._replace(rivals=rivals()) if name in JOINED else how, most, None, number, seed)
        if name == "dipole":
            # what scatters again where a boundary turns it back
            sums.by_order[2:] = 0.0
        return images(sums)

    def diffused(number):
        made = light.beams(how, known(), places, walks, False, False, number, seed)
        number += _LATER
        what = seen(number)
        later = dipole.seen(how, made, picks, number, seed).reshape(height, width, 3)
        every = np.ones((height, width), bool)
        half, later = smooth.smoothed(later, every, what, 0.5), smooth.smoothed(later, every, what)
        return {"": later, "orders": later, CLOSER: half - later}

    def gathered(number):
        made = light.beams(how, known(), places, walks, tabled and boundary == "negative", not tabled, number, seed)
        beyond = [_beyond(body, tabled and boundary == "mirrored") for body in how.bodies]
        number += _LATER
        what = seen(number) if tabled else None
        some = chosen(what, number) if tabled else None
        gather = Gather(made, tabled, second, _ALONE, fewer(), what.body.ravel(), beyond) if tabled \
            else Gather(made, tabled, second, picks, [picks] * len(how.bodies), np.full(height * width, -1), beyond)
        sums = transport.from_eye(how, most, gather, number, seed, found=False, chosen=some)
        layers, later = images(sums), sums.gathered.reshape(height, width, 3)
        if tabled:
            half, later = smooth.smoothed(later, some, what, 0.5), smooth.smoothed(later, some, what)
            layers |= {CLOSER: half - later}
        layers[""], layers["orders"] = layers[""] + later, layers["orders"] + later
        return layers

    def joined(number):
        width = [one * beams.narrower(number) for one in beams.half_widths(how)]
        entered, begun = zip(*(beams.lit(how, body, its, _LIT, number, seed) for body, its in enumerate(known())))
        if not tabled:
            made = light.beams(how, entries, places, walks, False, True, number, seed)
            begun = [beams.walked(one) for one in made]
        gather = beams.joins(how, [(entered, width[0], rivals()), (begun, width[1])])
        return images(transport.from_eye(how, most, gather, number + _BESIDE, seed, found=False))

    if name == "paths" and in_one_loop(how):
        from renderers.transport import passes

        camera = how.world.camera.origin
        return (passes.part(name, how.world, how.bodies, how.colours,
                            [body.name for body in how.bodies if holds(body.vertices, body.faces, camera)], seed),)
    if name in EACH_EVENT:
        return (Part(name, found),)
    made = {"dipole": (Part("dipoles", diffused),), "beams": (Part("joined", joined),),
            "beams+tables": (Part("joined", joined), Part("beams", gathered))}
    return Part("few", found), *made.get(name, (Part("beams", gathered),))


def in_one_loop(how) -> bool:
    """Whether `renderers.transport` can follow the paths of a scene: it finds no lights without extent through glass."""
    return not any(how.bent) and how.rivals is None and len(how.bodies) <= _MOST


def _bias(means, rgb) -> float | None:
    """Error of sharing between pixels, relative to the picture's mean: root mean square of what half the distance changes, and a
    third more, as it goes with the square of the distance.  Its own noise counts, so it is an upper bound; None where no pixels
    share.

    means : of passes, of each part (`renderers.progressive.Mean`);  rgb : (H, W, 3), the picture
    """
    found = [mean.layers[CLOSER] for mean in means if CLOSER in mean.layers]
    bright = float((rgb @ colour.LUMINANCE).mean())
    return 4 / 3 * float(np.sqrt(np.mean((found[0] @ colour.LUMINANCE) ** 2))) / bright if found and bright > 0 else None


def _beyond(body, mirrored):
    """Distances (L,) m of the extrapolated boundary outside of a body's, 2 A D; inf where nothing is mirrored.

    D = 1 / (3 sigma_t'), A = (1 + R2) / (1 - R1) with R1 = 2 int R c dc, R2 = 3 int R c^2 dc, R the reflectance from inside.
    """
    medium = body.medium
    if not mirrored:
        return np.full(len(medium.sigma_t), np.inf)
    x, weight = np.polynomial.legendre.leggauss(64)
    c, weight = (x + 1) / 2, weight / 2
    r = np.array([kernels.fresnel(one, 1 / body.index)[0] for one in c]) if not body.matched else np.zeros(64)
    a = (1 + 3 * np.sum(weight * r * c**2)) / (1 - 2 * np.sum(weight * r * c))
    return 2 * a / (3 * smooth.reduced(medium))


def _reasons(assets, bodies, asked, method):
    said, tabled = [], [asset for asset in assets if has_tables(asset)]
    if asked == "auto" and method == "paths":
        said.append("event by event, as an asset holds no tables of multiple scattering: few events do for thin bodies")
    if asked == "auto" and method == "shells":
        said.append("light jumps through empty spheres, as beams would be few on bodies this wide")
    if method == "dipole":
        said.append("dipole is approximate: light scattered twice and more (layer orders) leaves as by diffusion under a plane, "
                    "too bright, more so where more is absorbed; noisy where places of light are further apart than it spreads")
    if any(np.any(np.asarray(asset.multiple.peak) > 0) for asset in tabled):
        said.append("light in the forward peak of the phase function counts as not scattered, as in the tables")
    said += [f"the tables of {body.name} end at {reach:.3g} mean free paths, and it is {size:.3g} wide: beyond them light decays "
             "as diffusion has it" for body, asset in zip(bodies, assets, strict=True) for reach, size in _too_short(body, asset)]
    if method == "beams+tables" and any(not body.matched for body in bodies) or method == "beams":
        said.append("light that scatters in a body is blurred: that of lamps and one event over 1 % of the body's size, that of "
                    "more over 0.2 mean free paths to both sides, less in each pass; by mirrors and glass it comes by chance")
    elif any(not body.matched for body in bodies):
        said.append("light that scatters once reaches the eye through refracting boundaries by chance; that of lights without "
                    "extent is looked for from where it scatters, straight through one smooth boundary, not by mirrors or glass")
    return said


def _too_short(body, asset):
    """Extent of the tables and size of the body, mean free paths, where light that matters (1e-3 of it) goes beyond."""
    if not has_tables(asset):
        return []
    reach, k0 = np.asarray(asset.multiple.extent), np.asarray(asset.multiple.k0)
    size = np.ptp(body.vertices, axis=0).max() * body.medium.sigma_t
    beyond = (1 + k0 * reach) * np.exp(-k0 * reach) * (reach > 0)
    worst = int(np.argmax(beyond * (size > reach)))
    return [(reach[worst], size[worst])] if size[worst] > reach[worst] and beyond[worst] > _BEYOND else []
