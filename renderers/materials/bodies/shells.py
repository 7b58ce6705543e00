"""Jumps through the empty insides of bodies, by stored exits from spheres (Moon, Walter and Marschner 2007).

A path far from all surfaces goes at once to the largest of some spheres about it that is empty.  Where it leaves the sphere, in
which direction and with which weights, is drawn from the ends of walks that were made before.  Walks in larger spheres jump by
smaller ones, so that they take about as long.  The exits do not depend on the seed of a picture: what they miss of the truth is
the same in all of its passes.
"""

from functools import lru_cache

import numpy as np

from bakery.kernels import stream_key
from renderers.materials.bodies import _shells
from renderers.materials.bodies._shells import Shells
from renderers.threads import run
from renderers.transport.scattering import Scatterer
from renderers.transport.wavefront import streams

_SMALLEST, _LARGEST, _RATIO = 2.0, 256.0, 2**0.5  # of the radii, in the shortest mean free path of all wavelengths
_NUMBERS = 1 << 21  # stored for each radius: 190,000 exits at three wavelengths
_GROUPS = 8  # of the exits, which tell their error
_FAINT = 0.02  # share of the power below which light in a sphere is not worth storing


def none(waves) -> Shells:
    """No spheres."""
    return Shells(np.zeros(0), np.zeros((0, waves, 0, _shells.FACTORS + 2 * waves), np.float32))


def stored(medium, reach) -> Shells:
    """Exits from spheres in a medium (`Scatterer`) up to a radius `reach`, m; kept for the next body of that medium."""
    return _stored(tuple((array.tobytes(), array.shape) for array in medium), reach)


@lru_cache(maxsize=4)
def _stored(arrays, reach):
    medium = Scatterer(*(np.frombuffer(array).reshape(shape).copy() for array, shape in arrays))
    waves, columns = len(medium.sigma_t), _shells.FACTORS + 2 * len(medium.sigma_t)
    shortest = 1 / medium.sigma_t.max() if medium.sigma_t.max() > 0 else np.inf
    radii = shortest * _SMALLEST * _RATIO ** np.arange(1 + int(np.log(_LARGEST / _SMALLEST) / np.log(_RATIO)))
    radii = radii[radii <= reach]
    count = max(_NUMBERS // (columns * waves * _GROUPS), 1) * _GROUPS
    shells = Shells(radii, np.zeros((len(radii), waves, count, columns), np.float32))
    for at in range(len(radii)):
        states = streams(stream_key(0, "render.shells", at), waves * count)
        run(_shells.fill, len(states), medium, shells, at, _GROUPS, states)
        if at and not np.any(left(shells, at).mean(axis=0) > _FAINT):
            return Shells(radii[:at].copy(), shells.exits[:at].copy())
    return shells


def laid(transport):
    """A `setup.Transport` whose bodies have shells as large as there is room.

    Not bodies at whose events lights without extent are sampled: last events inside of a sphere take no light samples, and paths
    do not find such lights by chance.
    """
    clearance, sampled = float(transport.geometry.clear.max()), transport.world.without_extent
    return transport._replace(bodies=[body if bent or transport.chained or body.matched and sampled
                                      else body._replace(shells=stored(body.medium, clearance))
                                      for body, bent in zip(transport.bodies, transport.bent, strict=True)])


def left(shells, at):
    """Shares (groups, L) of the power that leave the sphere of radius number `at`, by groups of exits that know nothing of each
    other, where all wavelengths begin with the same."""
    waves, count = shells.exits.shape[1:3]
    rows = shells.exits[at].reshape(waves, _GROUPS, count // _GROUPS, -1)
    factor, like = rows[..., _shells.FACTORS:_shells.FACTORS + waves], rows[..., _shells.FACTORS + waves:]
    return np.sum(factor * like / like.mean(axis=-1, keepdims=True), axis=(0, 2), dtype=float) / (waves * (count // _GROUPS))


def error(shells):
    """Standard error of the share of the power that leaves a sphere, the largest of all; 0 where there is none."""
    every = [left(shells, at).std(axis=0, ddof=1) / _GROUPS**0.5 for at in range(len(shells.radii))]
    return float(np.max(every, initial=0.0))


def reasons(transport) -> list[str]:
    """Sentences about the stored exits of a scene's bodies."""
    jumps = [body for body in transport.bodies if len(body.shells.radii)]
    notes = []
    if jumps:
        every = {id(body.shells): body.shells for body in jumps}.values()
        count = sum(shells.exits[..., 0].size for shells in every)
        notes.append(f"{count:,} stored exits from spheres: the power that leaves one is right to {max(map(error, every)):.2%} "
                     "of what begins in it (standard error, the same in all passes)")
    if any(body.matched for body in jumps):
        notes.append("last events inside of spheres find lights by chance: small lights are noisier than with method paths")
    if len(jumps) < len(transport.bodies):
        notes.append("bodies without room for a sphere, and those at whose events lights without extent are sampled: light is "
                    "followed event by event, as by method paths")
    return notes
