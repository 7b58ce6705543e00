"""What rays meet, as one launch of Dr.Jit's that may be recorded: arrays of NumPy in, arrays of NumPy out.

Samples of lights and of directions are joined by the balance heuristic (Veach and Guibas, SIGGRAPH 1995).
"""

from typing import NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np

from renderers.mitsuba.variants import on_gpu

# m, where lights at infinity are taken to stand: beyond any scene, and its square is a float32
FAR = 1e12
# Of the largest coordinate of a mesh of glass: so far beside it rays go on.  At 1e-7 some 1e-3 of them meet it again, from 2e-7
# on none of 1e5.  Mitsuba's 9e-5 of a point's coordinate and one unit is 0.5 mm at 5 m, about a mean free path of wax
_BESIDE = 2e-6
LOBE = 2  # which random number of `World.shade` chooses a lobe of the BSDF: of dielectrics, below its share, reflection


def selected(record, rows):
    """Some rows, a mask, numbers or a slice, of all arrays of a named tuple, also of those in named tuples in it."""
    return type(record)(*(selected(values, rows) if isinstance(values, tuple) else values[rows] for values in record))


class LightSample(NamedTuple):
    """One light each, seen from n points.

    direction : (n, 3) float32, unit, towards the light
    distance : (n,) m, `FAR` of lights at infinity
    radiance : (n, 3) float32, over the density of the sample; for lights without extent intensity over distance^2 and
        probability.  0 where a surface hides the light
    density : (n,) float32, 1/sr, of the sample; of lights without extent the probability of their choice; 0 where it is hidden
    delta : (n,) bool, no other way of sampling finds this light
    light : (n,) int32, position in `World.light_names`, -1 where there is none
    """

    direction: np.ndarray
    distance: np.ndarray
    radiance: np.ndarray
    density: np.ndarray
    delta: np.ndarray
    light: np.ndarray

    of = selected

    def share(self, density):
        """Balance heuristic (n,) of this sample against directions drawn with `density` (n,) 1/sr."""
        return np.where(self.delta, 1.0, self.density / np.maximum(self.density + density, 1e-30))


class Shading(NamedTuple):
    """What n rays found, and where they go on.

    hit : (n,) bool, a surface
    point : (n, 3) m, where; of no meaning for rays that miss
    emitted : (n, 3) float32, radiance of the surface or, for rays that miss, of the environment, times the balance heuristic
        of the ray's direction against `World.lights`
    source : (n,) int32, position of that light in `World.light_names`, -1 where nothing shines
    by_light : (n,) float32, 1/sr, with which `World.lights` would have drawn it; 0 of a ray that is `delta`
    light : LightSample from the surface; its radiance times BSDF, cosine and balance heuristic, and 0 for rays that miss
    origin : (n, 3) m, of the next ray, off the surface
    direction : (n, 3) float32, of the next ray
    weight : (n, 3) float32, BSDF times cosine over density; 0 where the walk ends
    density : (n,) float32, 1/sr, of the next direction
    delta : (n,) bool, the next direction was drawn from a mirror, a pane of glass or no boundary at all
    """

    hit: np.ndarray
    point: np.ndarray
    emitted: np.ndarray
    source: np.ndarray
    by_light: np.ndarray
    light: LightSample
    origin: np.ndarray
    direction: np.ndarray
    weight: np.ndarray
    density: np.ndarray
    delta: np.ndarray


def light_number(positions, emitter):
    """Positions of emitters in `World.light_names`, by `positions` of Dr.Jit's numbers for them; its 0 is none."""
    return dr.gather(mi.Int32, positions, dr.reinterpret_array(mi.UInt32, emitter))


def by_number(things, values, kind=np.uint32, default=0):
    """Values of shapes or of emitters, by Dr.Jit's numbers for them, which begin at 1; `default` of what is none of these.  Where
    one is listed twice the later value holds."""
    numbers = [int(dr.reinterpret_array(mi.UInt32, (mi.ShapePtr if isinstance(thing, mi.Shape) else mi.EmitterPtr)(thing))[0])
               for thing in things]
    table = np.full(max(numbers, default=0) + 1, default, kind)
    for number, value in zip(numbers, values, strict=True):
        table[number] = value
    return table


def reaches(scene):
    """Of shapes, by Dr.Jit's numbers for them: the largest coordinate of a mesh of glass; inf of others, whose points are less
    precise, or for which it is of no matter, and of all on graphics cards, where `_BESIDE` was not measured."""
    glass = [] if on_gpu(mi.variant()) else [shape for shape in scene.shapes() if shape.is_mesh() and shape.bsdf() is not None
                                             and shape.bsdf().class_name() in ("SmoothDielectric", "RoughDielectric")]
    largest = [np.abs(np.array([shape.bbox().min, shape.bbox().max], float)).max() for shape in glass]
    return single(by_number([*scene.shapes(), *glass], [np.inf] * len(scene.shapes()) + largest, float))


def beside(surface, direction, reaches):
    """Where rays go on from surfaces: as Mitsuba's `spawn_ray` has it, but nearer to meshes of glass, by `reaches` of a scene."""
    coordinate = dr.max(dr.abs(surface.p))
    reach = dr.maximum(coordinate, dr.gather(mi.Float, reaches, dr.reinterpret_array(mi.UInt32, surface.shape)))
    off = dr.minimum(mi.math.RayEpsilon * (1 + coordinate), _BESIDE * reach)
    return mi.Point3f(surface.p + mi.Vector3f(surface.n) * dr.mulsign(off, dr.dot(surface.n, direction)))


def met(modes, scene, kinds, tables, origin, direction, drawn, random, by_ray, delta):
    """What `World.shade` gives, as Dr.Jit's arrays, in units of the scene; tables : positions of emitters in `World.light_names`,
    and `reaches`;  kinds : of a recording, `renderers.mitsuba.recording.pointers`;  modes : its `power` and `hidden`."""
    power, hidden = modes
    positions, reaches = tables
    context = mi.BSDFContext(mi.TransportMode.Importance if power else mi.TransportMode.Radiance)
    si = scene.ray_intersect(mi.Ray3f(origin, direction), ray_flags=mi.RayFlags.All, coherent=False)
    valid, delta = si.is_valid(), delta > 0

    before = dr.zeros(mi.Interaction3f)
    before.p = drawn
    seen = mi.DirectionSample3f(scene, si, before)
    by_light = scene.pdf_emitter_direction(before, seen, ~delta)
    emitted = seen.emitter.eval(si) * dr.select(delta, 1, _share(by_ray, by_light))

    bsdf = si.bsdf()
    sampled = valid & mi.has_flag(bsdf.flags(), mi.BSDFFlags.Smooth)
    light, radiance = scene.sample_emitter_direction(si, mi.Point2f(*random[:2]), hidden, sampled)
    towards = si.to_local(light.d)
    value, by_bsdf, next_way, weight = bsdf.eval_pdf_sample(context, si, towards, random[LOBE], mi.Point2f(*random[LOBE + 1:]),
                                                            valid)
    radiance = radiance * value * dr.select(light.delta, 1, _share(light.pdf, by_bsdf))
    away = si.to_world(next_way.wo)
    return (valid, si.p, finite(emitted), light_number(positions, seen.emitter), by_light,
            light.d, light.dist, finite(dr.select(sampled, radiance, 0)), light.pdf, light.delta,
            light_number(positions, light.emitter),
            beside(si, away, reaches), away, finite(dr.select(valid, weight, 0)), next_way.pdf,
            mi.has_flag(next_way.sampled_type, mi.BSDFFlags.Smooth))


def single(values):
    """(n,) numbers as Dr.Jit's, which takes NumPy's memory as it is and compiles anew for another alignment: always 64 bytes."""
    memory = np.empty(4 * len(values) + 64, np.uint8)
    start = -memory.ctypes.data % 64
    aligned = memory[start:start + 4 * len(values)].view(np.float32)
    aligned[:] = values
    return mi.Float(aligned)


def rows(values):
    """Numbers (n,) of rays, one of them twice: the kernel of a single number is another than that of several."""
    return single(values if len(values) != 1 else np.repeat(values, 2))


def columns(values):
    """Columns one by one: a vector made of (3, n) would bake n into the kernel."""
    return [rows(column) for column in np.asarray(values).T]


def uniform(random, first, count):
    # what rounds to 1 in single precision is outside of what samplers take
    return columns(np.minimum(np.asarray(random)[:, first:first + count], 1 - 2.0**-24))


def _share(mine, rival):
    """The balance heuristic."""
    total = mine + rival
    return dr.select(total > 0, mine / total, 0)


def finite(colour):
    """A weight that overflowed counts as dark, as in `passes.render`: it would blot out its pixel."""
    return dr.select(dr.all(dr.isfinite(colour)), colour, 0)


def empty(result):
    """Without its rays: Dr.Jit ends the process over arrays of length 0."""
    return result[:0] if isinstance(result, np.ndarray) else selected(result, slice(0))


def arrays(count, *values):
    """Dr.Jit's arrays as NumPy's, (count,) or (count, 3), all computed by one launch; one number for all rays is repeated."""
    dr.eval(*values)
    return [np.stack([_row(count, column) for column in value], axis=1) if dr.depth_v(value) > 1 else _row(count, value)
            for value in values]


def _row(count, value):
    # of a recording, `World._meets`, a constant has the length of the call that was recorded
    constant = value.state == dr.VarState.Literal
    row = np.asarray(value)
    return np.full(count, row[0]) if constant or len(row) == 1 else row[:count].copy()  # a copy: the memory is Dr.Jit's
