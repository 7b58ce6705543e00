"""The methods of a scene: which passes make its picture, and what is to be said of them."""

import math
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from bakery import kernels
from bakery.grammar import fields
from renderers import colour
from renderers.materials.bodies import beams, chains, dipole, events, light, mutations, refraction, shells, smooth, transport
from renderers.materials.bodies.bias import CLOSER, SHARPER, TURNS
from renderers.materials.bodies.bodies import Body, flaws, has_tables, holds, laid_out, medium_of, rounded, solid_shape
from renderers.materials.bodies.declaration import DIFFUSED, FEW, GATHERED, JOINED, MUTATED
from renderers.materials.bodies.declared import methods
from renderers.materials.bodies.gather import Gather
from renderers.materials.bodies.paths import UNLIMITED
from renderers.materials.bodies.setup import Sums, Transport
from renderers.materials.bodies.thin import WALKS, density
from renderers.pictures.engine import ORDERS, Part
from renderers.pictures.passes import Method
from renderers.scene.budget import percent
from renderers.scene.declaration import settled
from renderers.transport import wavefront
from renderers.transport.paths import Colours
from renderers.transport.scattering import of_asset

ENTRIES, PICKS, _LEAST, _ALONE = 16384, 64, 4, 32
_LIT = 1 << 15  # places on each boundary where beams begin that lines of sight meet
_FIRST = 8192  # places that tell where light comes into a body
# Of the pixels, whose paths gather beams in passes of a short render: with tables a pass of bumpy_ball_point, 192 x 192, takes
# 0.84 s in place of 2.8, and beams are a hundredth of its variance; a sixteenth left bright spots
_FEWEST = 1 / 8
# and of those, and of the events, that light of lights without extent is looked for from there;  beside tables, which bring most
# of it, an eighth takes 0.83 of the time of a quarter with the same variance (bumpy_ball_point, 512 x 512)
_FEWEST_SEARCHED, _BESIDE_TABLES = 1 / 4, 1 / 8
# pixels that look beams up in tables in any case: they take 0.1 to 0.3 s, less than the beams; all of a picture of 64 x 48
_LOOKING_UP = 4096
_MOST = 31  # bodies of which one loop keeps in which a path is
_BEYOND = 1e-3  # share of the light beyond the tables that is worth a word
_NOISES = ("noise", "noise_mean", "noise_region")  # of a report
_UNLIT = "lights shine, and no pass found any: how far the picture is off is not known"
_UNLIT_METHOD = "paths"  # of scenes in which nothing shines: needs neither beams nor tables


def prepare(job, world, seed) -> Method:
    """The method that a scene asks for; `job` is a `renderers.pictures.running.Render`, `world` the surfaces and lights
    around."""
    values, assets = job.scene.values, job.assets
    if any(not np.array_equal(asset.wavelength, assets[0].wavelength) for asset in assets):
        raise job.scene.wrong("materials", "the assets have different wavelengths; assets of the same ones would do")
    entries = values.materials
    setup = transport_of(world, [entry.where.shape for entry in entries], assets, [entry.index for entry in entries],
                       lambda number, key, message: job.scene.wrong(f"materials[{number}].{key}", message), values.method)
    name, kinds = of(setup, values.method, entries[0].tables, seed)
    if world.dark:
        return Method(name, kinds, [], lambda estimate: {"bias": None})
    declared = methods()[name]
    looped = _looped(setup, declared)
    reasons = _reasons(assets, setup.bodies, declared, looped) + (faults := flaws(world, setup.bodies))
    reasons += shells.reasons(shells.laid(setup)) if declared.spheres else []
    missing, sentences = chains.left_out(setup, seed)
    if coarse := rounded(setup.bodies) if looped else []:
        missing, sentences = None, [*sentences, *coarse]

    def after(estimate):
        # how far off some methods are, or how much light is left out, nobody states; what else is known would pass for all of it
        measurable = declared.measured is not None and missing is not None and not faults
        bias = declared.measured(estimate.means.values(), estimate.rgb, missing) if measurable else None
        any_light = np.any(estimate.rgb)
        remarks = []
        if bias is None and measurable and any_light and not sentences:  # no pixels shared, nothing was left out
            bias = 0.0 if declared.exact else None
            remarks = [] if declared.exact else [f"no pixels share here, by which the bias of {name} is measured"]
        unlit = {} if any_light else dict.fromkeys(_NOISES) | {"unlit": [_UNLIT]}
        chained = _of_chains(kinds[-1].render.figures()) if declared.metropolis else {}
        return {"bias": bias, "left_out": sentences} | chained | {"reasons": [*remarks, *chained.get("reasons", ())]} | unlit

    return Method(name, kinds, [*reasons, *sentences], after, features=lambda quality: features_of(setup, seed),
                  unmeasured=bool(faults))


def _of_chains(figures):
    """What a report says of the chains of its passes, `renderers.transport.metropolis.Figures`."""
    if figures.small_steps is None:
        return {"chains": figures._asdict()}
    error = "" if figures.error is None else f" ({percent(figures.error / figures.normalisation)})"
    return {"chains": figures._asdict(), "reasons": [
        f"chains are normalised by the mean luminance of paths drawn alike, {figures.normalisation:.3g}{error}; they have taken "
        f"{percent(figures.small_steps)} of small steps and {percent(figures.large_steps)} of large ones"]}


def features_of(setup, seed):
    """What the camera sees, `renderers.pictures.denoise.Features`; None of more bodies than a loop keeps apart."""
    from renderers.transport import features

    return features.first_hits(setup.world, setup.bodies, setup.colours, seed) if len(setup.bodies) <= _MOST else None


def of(setup, name, boundary, seed):
    """The method of a name, which is another where that chooses, and its parts; parameters as those of `parts`."""
    name = settled(methods(), name)
    if setup.world.dark:
        # no beams begin, and tables and spheres need not be there
        return name, parts(setup, _UNLIT_METHOD, boundary, seed)
    return name, parts(shells.laid(setup) if methods()[name].spheres else setup, name, boundary, seed)


def transport_of(world, names, assets, indices, wrong, name="vrl+tables") -> Transport:
    """How light goes in a scene.

    names : of the shapes that are bodies;  assets : of each;  indices : refractive index of each, or None
    wrong : function of (number of a body, what of it, message) -> the exception to raise where something is wrong
    name : of the method; assets have to hold the tables that it looks up
    """
    shapes = world.shapes()
    bodies = [_body(shapes, *entry, lambda key, message, number=number: wrong(number, key, message),
                    _UNLIT_METHOD if world.dark else name)
              for number, entry in enumerate(zip(names, assets, indices, strict=True))]
    bodies, geometry = laid_out(world, bodies, wrong)
    colours = Colours.of(assets[0].wavelength)
    panes = any(shape.index is not None and shape.smooth and shape.name not in names for shape in shapes)
    lights = world.ideal_lights() if world.without_extent else []
    enclosed = [any(not body.matched and holds(body, light.place) for body in bodies) and not light.distant for light in lights]
    lamps = frozenset(number for number, body in enumerate(bodies)
                      if world.lights_in([np.array([body.vertices.min(axis=0), body.vertices.max(axis=0)])]))
    setup = Transport(world, bodies, geometry, colours, [refraction.bent(world, body, shapes) for body in bodies], panes=panes,
                      points=tuple(light for light, inside in zip(lights, enclosed, strict=True) if not inside),
                      enclosed=tuple(light for light, inside in zip(lights, enclosed, strict=True) if inside), lamps=lamps)
    if methods()[name].metropolis and not world.dark and not in_one_loop(setup):
        raise wrong(0, "method", f"method {name} finds no light of lamps without extent through smooth glass, and follows at "
                                 f"most {_MOST} bodies; paths or vrl+tables would do")
    return setup


def _body(shapes, name, asset, index, wrong, method):
    """The body that a shape is."""
    shape = solid_shape(shapes, name, index, wrong)
    vertices, faces = shape.vertices, shape.faces
    medium = medium_of(asset) if has_tables(asset) else of_asset(asset)
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
    come = density(vertices, faces, reduced)
    if come >= method.fewest_beams:
        return ""
    size = float(np.ptp(vertices, axis=0).max() * np.max(reduced))
    able = fields.one_of([name for name, declared in methods().items()
                          if not (declared.fewest_beams or declared.surface or declared.surface_far)])
    return (f"{name} is {size:.3g} transport mean free paths wide: to a square one of its boundary come {come:.1g} beams of a "
            f"pass, and method {method.name} needs {method.fewest_beams:g}; {able} would do")


def parts(setup, name, boundary, seed, places=ENTRIES, walks=WALKS, picks=PICKS):
    """The parts of a method, as `renderers.pictures.progressive` takes them.

    setup : `setup.Transport`;  name, boundary : method and boundary as a scene names them
    places, walks : places where light comes in, and walks
    picks : beams that are drawn for a place of a body: by all lines of sight together that share their light, `_LEAST` by each;
        with tables `_ALONE` by those that do not
    """
    method = methods()[name]
    looped = _looped(setup, method)
    if method.metropolis and not looped:
        raise ValueError(f"method {name} has no paths but those of the loop")
    if looped and not method.parts:
        return (_by_loop(setup, name, method, seed),)
    if method.joined:
        # they bring lights without extent, too
        setup = setup._replace(bent=[[] for _ in setup.bodies])
    kinds = _Passes(setup, method, boundary, seed, _Counts(places, walks, picks))
    of_kind = {FEW: _by_shares(FEW, kinds.by_paths, _BESIDE_TABLES if method.tabled else _FEWEST_SEARCHED),
               GATHERED: _by_shares(GATHERED, kinds.gathered, kinds.fewest, smooth.FULL_OF_FEW if method.tabled else math.inf),
               DIFFUSED: Part(DIFFUSED, kinds.diffused, noisier=partial(smooth.noisier, lines=1, full=smooth.FULL_OF_FEW)),
               JOINED: Part(JOINED, kinds.joined),
               MUTATED: Part(MUTATED, kinds.mutations, noisier=kinds.mutations.noisier)}
    return tuple(_by_loop(setup, FEW, method, seed, kinds.most) if kind == FEW and looped else of_kind[kind]
                 for kind in method.parts) or (_by_shares(name, kinds.by_paths, _FEWEST_SEARCHED),)


def _by_shares(name, passes, fewest, full=math.inf, share=1) -> Part:
    """A part of whose lines of sight a share, in short renders, gathers beams or has its light looked for; full : as
    `smooth.falling`"""
    return Part(name, partial(passes, share=share), fewer=partial(_by_shares, name, passes, fewest, full), fewest=fewest,
                noisier=partial(smooth.noisier, lines=share, full=full))


def _by_loop(setup, name, method, seed, most=None) -> Part:
    """Paths of a method in the loop; most : of each body, events between two surfaces, None: any number"""
    from renderers.transport import metropolis, passes

    asked = name, setup.world, setup.bodies, setup.colours, seed
    if method.metropolis:
        return metropolis.part(*asked, colour.LUMINANCE)
    part = passes.part(*asked, most=most, shared=True)
    return _without_later(part) if method.diffused else part


def _without_later(part) -> Part:
    """The part without light of two and more events."""
    def render(number):
        layers = part.render(number)
        for name in ORDERS[2:]:
            layers[""] -= layers[name]
            layers[name] = np.zeros_like(layers[name])
        return layers

    return part._replace(render=render, fewer=lambda samples: _without_later(part.fewer(samples)))


class _Counts(NamedTuple):
    """Of a pass: places where light comes in, walks of it, beams that are drawn."""

    places: int
    walks: int
    picks: int


class _Passes:
    """Passes of a method: functions of their number, which give layers (H, W, 3) by name.

    most : of each body, events between two surfaces that a path may have
    """

    def __init__(self, setup, method, boundary, seed, counts):
        self._setup, self._method, self._seed, self._counts = setup, method, seed, counts
        self._size = setup.world.size
        self._negative, self._mirrored = (method.tabled and boundary == kind for kind in ("negative", "mirrored"))
        self._second = [method.second(setup.world, body) for body in setup.bodies]
        self.most = [UNLIMITED if not method.parts else 1 if joins else 2 for joins in self._second]
        # the least share of the pixels that gather
        self.fewest = min(1.0, max(_FEWEST, _LOOKING_UP / math.prod(self._size) if method.tabled else 0.0))

    def by_paths(self, number, share=1):
        """Light that paths find by themselves, and that of lights without extent which they cannot find, of a share of them."""
        setup, method = self._setup._replace(searched=share), self._method
        changed = Sums(self._size[0] * self._size[1], by_paths=False)
        gather = chains.gathering(setup, self._entries, number, self._seed, not method.parts, method.beams_of_events, changed,
                                  share) if setup.chained else None
        if method.joined:
            setup = setup._replace(rivals=self._rivals)
        sums = transport.from_eye(setup, self.most, gather, kernels.stream_key(self._seed, "render.translucent", number))
        if method.diffused:
            # what scatters again where a boundary turns it back
            sums.by_order[2:] = 0.0
        layers = self._images(sums)
        if gather:
            layers[SHARPER] = changed.by_order.sum(axis=0).reshape(*self._size, 3)
        return layers

    def diffused(self, number):
        """Light of beams by diffusion."""
        beams_in, key = self._beams(number), self._key(number)
        view = self._view(key)
        later = dipole.seen(self._setup, beams_in, self._counts.picks, key).reshape(*self._size, 3)
        every, distance = np.ones(self._size, bool), smooth.falling(number + 1, False, smooth.FULL_OF_FEW)
        half, later = (smooth.smoothed(later, every, view, part * distance) for part in (0.5, 1.0))
        return {"": later, "orders": later, CLOSER[number % 2]: half - later}

    def gathered(self, number, share=1):
        """Light of beams that the paths of a share of the pixels gather for all: by tables, or from virtual ray lights."""
        setup, tabled, picks = self._setup, self._method.tabled, self._counts.picks
        beams_in = self._beams(number, negative=self._negative, by_events=not tabled)
        beyond = [_beyond(body, self._mirrored) for body in setup.bodies]
        key = self._key(number)
        view = self._view(key) if tabled else None
        gathers = self._gathers(view, number) if tabled else np.ones(self._size, bool)
        if tabled:
            gather = Gather(beams_in, True, self._second, _ALONE, self._shared_picks, view.body.ravel(), beyond)
        else:
            nobody = np.full(self._size[0] * self._size[1], -1)
            gather = Gather(beams_in, False, self._second, picks, [picks] * len(setup.bodies), nobody, beyond)
        chosen = gathers & self._gathering_pixels(number, share)
        sums = transport.from_eye(setup, self.most, gather, key, by_paths=False, chosen=chosen)
        sums.by_order /= share
        sums.gathered /= share
        layers, later = self._images(sums), sums.gathered.reshape(*self._size, 3)
        if tabled:
            distance = smooth.falling(share * (number + 1), not gathers.all(), smooth.FULL_OF_FEW)
            half, later = (smooth.smoothed(later, gathers, view, part * distance) for part in (0.5, 1.0))
            layers |= {CLOSER[number % 2]: half - later}
        layers[""], layers["orders"] = layers[""] + later, layers["orders"] + later
        return layers

    @cached_property
    def mutations(self):
        """`mutations.Mutations`: light of beams by the tables, as states bring it that are drawn by a guess."""
        beyond = [_beyond(body, self._mirrored) for body in self._setup.bodies]
        asked = mutations.Settings(self._negative, self._second, self.most, beyond, self._counts.places, self._counts.walks)
        return mutations.Mutations(self._setup, lambda: self._entries, asked, self._seed)

    def joined(self, number):
        """Light of beams that lines of sight cross."""
        setup = self._setup
        width = [widths * beams.narrower(number) for widths in beams.half_widths(setup)]
        entered, inside = zip(*(beams.entering(setup, body, entries, _LIT, number, self._seed)
                               for body, entries in enumerate(self._entries)))
        first = entered, beams.spread(width[0], self._rivals)
        changed = Sums(self._size[0] * self._size[1], by_paths=False)
        if self._method.tabled:
            second = [beams.of_events(setup, body, paths) for body, paths in enumerate(inside)]
            gather = beams.joins(setup, [first, (second, beams.spread(width[1]))], changed=changed)
        else:
            walked = events.of_walks(setup, self._entries, self._counts.places, self._walks, number, self._seed)
            discs, against = events.discs(width[1])
            others = walked.beams, beams.spread(width[1], against=against)
            gather = beams.joins(setup, [first, others], [(walked.points, discs)], changed=changed)
        key = kernels.stream_key(self._seed, "render.joined", number)
        layers = self._images(transport.from_eye(setup, self.most, gather, key, by_paths=False))
        return layers | {TURNS[number % 2]: changed.by_order.sum(axis=0).reshape(*self._size, 3)}

    def _images(self, sums):
        by_order = [image.reshape(*self._size, 3) for image in sums.by_order]
        return {"": sum(by_order)} | dict(zip(ORDERS, by_order))

    def _beams(self, number, *, negative=False, by_events=False):
        return light.beams(self._setup, self._entries, self._counts.places, self._counts.walks, negative, by_events, number,
                           self._seed)

    def _key(self, number):
        """Of the lines of sight that gather beams in a pass."""
        return kernels.stream_key(self._seed, "render.gathered", number)

    def _view(self, key):
        """What the camera sees of bodies in a pass."""
        return smooth.seen(self._setup, transport.begin(self._setup, np.arange(self._size[0] * self._size[1]), key))

    def _gathers(self, view, number):
        """Pixels that gather; all where what they find is not shared."""
        return np.ones(self._size, bool) if any(self._second) else smooth.chosen(view, number)

    def _gathering_pixels(self, number, share):
        """(H, W) bool, a share of the pixels, one of each block of neighbours by chance; share : a power of 1/2."""
        several, (height, width) = round(1 / share), self._size
        rows = 1 << (several.bit_length() - 1) // 2
        columns = several // rows
        y, x = np.indices(self._size)
        states = wavefront.streams(kernels.stream_key(self._seed, "render.shares", number), height * width)
        numbers = wavefront.uniforms(states, 1)
        drawn = np.floor(several * numbers[y // rows * -(-width // columns) + x // columns, 0])
        return y % rows * columns + x % columns == drawn

    @cached_property
    def _entries(self):
        """`light.Entries` of each body."""
        return [light.entries_of(self._setup, body, _FIRST, self._seed) for body in range(len(self._setup.bodies))]

    @cached_property
    def _walks(self):
        """Walks of light whose events lines of sight meet, of a pass."""
        return events.walks_of(self._setup, self._entries, self._seed)

    @cached_property
    def _shared_picks(self):
        """Beams of a line of sight that shares what it gathers, in each body."""
        view = self._view(self._key(0))
        shares = smooth.sharing(view, self._gathers(view, 0), len(self._setup.bodies))
        return [min(max(math.ceil(self._counts.picks / share), _LEAST), _ALONE) for share in shares]

    @property
    def _rivals(self):
        return beams.rivals_of(self._setup, self._entries, _LIT)


def in_one_loop(setup) -> bool:
    """Whether `renderers.transport` can follow the paths of a scene: it finds no lights without extent through glass."""
    return not (setup.chained or any(setup.bent)) and setup.rivals is None and len(setup.bodies) <= _MOST


def _looped(setup, method) -> bool:
    """Whether it follows a method's paths: without jumps, and where no beams bring what they find through boundaries, too."""
    return not method.spheres and in_one_loop(setup) and not (method.joined and not all(setup.matched))


def _beyond(body, mirrored):
    """Distances (L,) m of the extrapolated boundary outside of a body's, 2 A D; inf where nothing is mirrored.

    D = 1 / (3 sigma_t'), A = (1 + R2) / (1 - R1) with R1 = 2 int R c dc, R2 = 3 int R c^2 dc, R the reflectance from inside.
    """
    medium = body.medium
    if not mirrored:
        return np.full(len(medium.sigma_t), np.inf)
    x, weight = np.polynomial.legendre.leggauss(64)
    c, weight = (x + 1) / 2, weight / 2
    r = np.array([kernels.fresnel(cosine, 1 / body.index)[0] for cosine in c]) if not body.matched else np.zeros(64)
    a = (1 + 3 * np.sum(weight * r * c**2)) / (1 - 2 * np.sum(weight * r * c))
    return 2 * a / (3 * smooth.reduced(medium))


def _reasons(assets, bodies, method, looped):
    tabled = [asset for asset in assets if has_tables(asset)]
    notes = [method.leaves_out] if method.leaves_out else []
    if any(np.any(np.asarray(asset.multiple.peak) > 0) for asset in tabled):
        notes.append("light in the forward peak of the phase function counts as not scattered, as in the tables")
    notes += [f"the tables of {body.name} end at {reach:.3g} mean free paths, and it is {size:.3g} wide: beyond them light "
              "decays as diffusion has it"
              for body, asset in zip(bodies, assets, strict=True) for reach, size in _too_short(body, asset)]
    turned = any(not body.matched for body in bodies)
    if method.blurred[0 if turned else 1]:
        notes.append("light that scatters in a body is blurred: that of lamps and one event over 1 % of the body's size, that of "
                    "more over 0.2 mean free paths to both sides, less in each pass; by mirrors and glass it comes by chance")
    elif turned and looped:
        notes.append("where bodies scatter light, the ways to lamps, suns and skies are searched for: out of smooth bodies by "
                     "refraction, also at panes, and to wide lights by mirrors, out of rough bodies through the boundary alone, "
                     "the latter two where that saves noise; light by other ways comes by chance")
    elif turned:
        notes.append("light that scatters once reaches the eye through refracting boundaries by chance; that of lights without "
                    "extent is looked for from where it scatters, straight through one smooth boundary; what smooth boundaries "
                    "turn more than once is spread over 1 % of the body's size to both sides, less in each pass")
    return notes


def _too_short(body, asset):
    """Extent of the tables and size of the body, mean free paths, where light that matters (1e-3 of it) goes beyond."""
    if not has_tables(asset):
        return []
    reach, k0 = np.asarray(asset.multiple.extent), np.asarray(asset.multiple.k0)
    size = np.ptp(body.vertices, axis=0).max() * body.medium.sigma_t
    beyond = (1 + k0 * reach) * np.exp(-k0 * reach) * (reach > 0)
    worst = int(np.argmax(beyond * (size > reach)))
    return [(reach[worst], size[worst])] if size[worst] > reach[worst] and beyond[worst] > _BEYOND else []
