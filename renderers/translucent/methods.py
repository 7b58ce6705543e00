"""The methods of a scene: which passes make its picture, and what is to be said of them."""

from __future__ import annotations

import math

import numpy as np

from bakery import kernels
from bakery.grammar import fields
from renderers import colour
from renderers.declaration import settled
from renderers.engine import Part
from renderers.passes import Method
from renderers.translucent import beams, chains, dipole, light, refraction, shells, smooth, thin, transport
from renderers.translucent.bias import CLOSER, SHARPER
from renderers.translucent.bodies import Body, has_tables, holds, laid_out, medium_of, solid_shape, untabled
from renderers.translucent.declaration import DIFFUSED, FEW, GATHERED, JOINED
from renderers.translucent.declared import methods
from renderers.translucent.thin import WALKS
from renderers.translucent.transport import UNLIMITED, Colours, Gather, Transport

ENTRIES, PICKS, _LEAST, _ALONE = 16384, 64, 4, 32
_LIT = 1 << 15  # places on each boundary where beams begin that lines of sight meet
_FIRST = 8192  # places that tell where light comes into a body
_LATER = 1 << 31  # passes of lines of sight that gather beams are numbered from here
_BESIDE = 3 << 30  # and of those that meet beams
_MOST = 31  # bodies of which one loop keeps in which a path is
_BEYOND = 1e-3  # share of the light beyond the tables that is worth a word
_NOISES = ("noise", "noise_mean", "noise_region")  # of a report
_UNLIT = "lights shine, and no pass found any: how far the picture is off is not known"
_UNLIT_METHOD = "paths"  # of scenes in which nothing shines: needs neither beams nor tables
_LAYERS = ("order0", "order1", "order2", "orders")


def prepare(job, world, seed) -> Method:
    """The method that a scene asks for; `job` is a `renderers.running.Render`, `world` the surfaces and lights around."""
    values, assets = job.scene.values, job.assets
    if any(not np.array_equal(one.wavelength, assets[0].wavelength) for one in assets):
        raise job.scene.wrong("materials", "the assets have different wavelengths; assets of the same ones would do")
    entries = values.materials
    how = transport_of(world, [one.where.shape for one in entries], assets, [one.index for one in entries],
                       lambda number, key, message: job.scene.wrong(f"materials[{number}].{key}", message), values.method)
    name, made = of(how, values.method, entries[0].tables, seed)
    if world.dark:
        return Method(name, made, [], lambda estimate: {"bias": None})
    declared = methods()[name]
    reasons = _reasons(assets, how.bodies, declared, declared.in_one_loop and in_one_loop(how))
    reasons += shells.reasons(shells.laid(how)) if declared.spheres else []
    missing, sentences = chains.left_out(how, seed)

    def after(estimate):
        # how far off some methods are, or how much light is left out, nobody states; what else is known would pass for all of it
        measurable = declared.measured is not None and missing is not None
        bias = declared.measured(estimate.means.values(), estimate.rgb, missing) if measurable else None
        unlit = {} if np.any(estimate.rgb) else dict.fromkeys(_NOISES) | {"reasons": [_UNLIT]}
        return {"bias": bias, "left_out": sentences} | unlit

    return Method(name, made, [*reasons, *sentences], after, features=lambda: features_of(how, seed))


def features_of(how, seed):
    """What the camera sees, `renderers.denoise.Features`; None of more bodies than a loop keeps apart."""
    from renderers.transport import features

    return features.first_hits(how.world, how.bodies, how.colours, seed) if len(how.bodies) <= _MOST else None


def of(how, name, boundary, seed):
    """The method of a name, which is another where that chooses, and its parts; parameters as those of `parts`."""
    name = settled(methods(), name)
    if how.world.dark:
        # no beams begin, and tables and spheres need not be there
        return name, parts(how, _UNLIT_METHOD, boundary, seed)
    return name, parts(shells.laid(how) if methods()[name].spheres else how, name, boundary, seed)


def transport_of(world, names, assets, indices, wrong, name="vrl+tables") -> Transport:
    """How light goes in a scene.

    names : of the shapes that are bodies;  assets : of each;  indices : refractive index of each, or None
    wrong : function of (number of a body, what of it, message) -> the exception to raise where something is wrong
    name : of the method; assets have to hold the tables that it looks up
    """
    shapes = world.shapes()
    bodies = [_body(shapes, *one, lambda key, message, number=number: wrong(number, key, message),
                    _UNLIT_METHOD if world.dark else name)
              for number, one in enumerate(zip(names, assets, indices, strict=True))]
    bodies, geometry = laid_out(world, bodies, wrong)
    waves = np.asarray(assets[0].wavelength, float)
    colours = Colours(np.ascontiguousarray(colour.srgb_matrix(waves)), np.ascontiguousarray(colour.spread_matrix(waves)))
    panes = any(shape.index is not None and shape.smooth and shape.name not in names for shape in shapes)
    lights = world.ideal_lights() if world.without_extent else []
    enclosed = [any(not body.matched and holds(body, light.place) for body in bodies) and not light.distant for light in lights]
    lamps = frozenset(number for number, body in enumerate(bodies)
                      if world.lights_in([np.array([body.vertices.min(axis=0), body.vertices.max(axis=0)])]))
    return Transport(world, bodies, geometry, colours, [refraction.bent(world, body, shapes) for body in bodies], panes=panes,
                     points=tuple(light for light, inside in zip(lights, enclosed, strict=True) if not inside),
                     enclosed=tuple(light for light, inside in zip(lights, enclosed, strict=True) if inside), lamps=lamps)


def _body(shapes, name, asset, index, wrong, method):
    """The body that a shape is."""
    shape = solid_shape(shapes, name, index, wrong)
    vertices, faces = shape.vertices, shape.faces
    medium = medium_of(asset) if has_tables(asset) else untabled(asset)
    declared = methods()[method]
    if fault := _too_wide(name, vertices, faces, smooth.reduced(medium), declared):
        raise wrong("where.shape", fault)
    tabled = has_tables(asset) or declared.reads_tables
    if tabled and not hasattr(asset.multiple, "segment"):
        raise wrong("asset", "its stage multiple holds no tables of segments; multiple_scattering: {sources: [point, segment]} "
                             "in its recipe would do")
    tables = [(points, segments) for points, segments, _ in asset.multiple.segment.tables()] if tabled else []
    return Body(name, vertices, faces, shape.index, shape.smooth, medium, tables, False, shells.none(len(medium.sigma_t)))


def _too_wide(name, vertices, faces, reduced, method):
    """What is wrong with a method by beams for a body of so many transport mean free paths; "" where nothing is."""
    density = thin.density(vertices, faces, reduced)
    if density >= method.fewest_beams:
        return ""
    wide = float(np.ptp(vertices, axis=0).max() * np.max(reduced))
    able = fields.one_of([name for name, other in methods().items() if not other.fewest_beams])
    return (f"{name} is {wide:.3g} transport mean free paths wide: to a square one of its boundary come {density:.1g} beams of a "
            f"pass, and method {method.name} needs {method.fewest_beams:g}; {able} would do")


def parts(how, name, boundary, seed, places=ENTRIES, walks=WALKS, picks=PICKS):
    """The parts of a method, as `renderers.progressive` takes them.

    how : `transport.Transport`;  name, boundary : method and boundary as a scene names them
    places, walks : places where light comes in, and walks
    picks : beams that are drawn for a place of a body: by all lines of sight together that share their light, `_LEAST` by each;
        with tables `_ALONE` by those that do not
    """
    height, width = how.world.size
    method = methods()[name]
    tabled, second = method.tabled, [method.second(how.world, body) for body in how.bodies]
    if method.joined:
        # they bring lights without extent, too
        how = how._replace(bent=[[] for _ in how.bodies])
    most = [UNLIMITED if not method.parts else 1 if joins else 2 for joins in second]

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
        gather = chains.gathering(how, known(), number, seed, not method.parts, method.beams_of_events) \
            if how.chained else None
        sums = transport.from_eye(how._replace(rivals=rivals()) if method.joined else how, most, gather, number, seed)
        if gather:
            sums.by_order += gather.wide.by_order
        if method.diffused:
            # what scatters again where a boundary turns it back
            sums.by_order[2:] = 0.0
        layers = images(sums)
        if gather:
            layers[SHARPER] = (gather.sharp.by_order - gather.wide.by_order).sum(axis=0).reshape(height, width, 3)
        return layers

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

    if method.in_one_loop and in_one_loop(how):
        from renderers.transport import passes

        return (passes.part(name, how.world, how.bodies, how.colours, seed),)
    passes_of = {FEW: found, GATHERED: gathered, DIFFUSED: diffused, JOINED: joined}
    return tuple(Part(kind, passes_of[kind]) for kind in method.parts) or (Part(name, found),)


def in_one_loop(how) -> bool:
    """Whether `renderers.transport` can follow the paths of a scene: it finds no lights without extent through glass."""
    return not (how.chained or any(how.bent)) and how.rivals is None and len(how.bodies) <= _MOST


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


def _reasons(assets, bodies, method, looped):
    tabled = [asset for asset in assets if has_tables(asset)]
    said = [method.leaves_out] if method.leaves_out else []
    if any(np.any(np.asarray(asset.multiple.peak) > 0) for asset in tabled):
        said.append("light in the forward peak of the phase function counts as not scattered, as in the tables")
    said += [f"the tables of {body.name} end at {reach:.3g} mean free paths, and it is {size:.3g} wide: beyond them light decays "
             "as diffusion has it" for body, asset in zip(bodies, assets, strict=True) for reach, size in _too_short(body, asset)]
    turned = any(not body.matched for body in bodies)
    if method.blurred[0 if turned else 1]:
        said.append("light that scatters in a body is blurred: that of lamps and one event over 1 % of the body's size, that of "
                    "more over 0.2 mean free paths to both sides, less in each pass; by mirrors and glass it comes by chance")
    elif turned and looped:
        said.append("light of lamps that bodies of smooth glass see as small is looked for from where it scatters, straight "
                    "through a smooth boundary; that of wide ones, and what mirrors, panes and rough glass turn, comes by chance")
    elif turned:
        said.append("light that scatters once reaches the eye through refracting boundaries by chance; that of lights without "
                    "extent is looked for from where it scatters, straight through one smooth boundary; what smooth boundaries "
                    "turn more than once is spread over 1 % of the body's size to both sides, less in each pass")
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
