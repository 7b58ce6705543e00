"""What is ahead of paths among several bodies of grains: which body, or surface of the scene, they come to next."""

import numpy as np

from renderers.materials.grains import far
from renderers.materials.grains._grains import OFF, UNKNOWN
from renderers.materials.grains._paths import GRAINS, MEDIUM

TURNED = -2  # less the number of a body: of paths that its baked surface turns, in place of that


def look_ahead(world, transport, paths, at):
    """Finds how far it is for paths `at` (m,) to the first surface of the scene or to what is of another body than theirs, and
    the body of those that have none."""
    if not len(at):
        return
    surface = world.trace(paths.origin[at], paths.direction[at], np.inf)
    if len(transport.bodies) == 1:
        paths.far[at], paths.body[at] = surface, 0
        return
    anew = paths.body[at] < 0
    _choose(paths, at, surface, _entries(transport, paths, at, surface, anew), anew)


def look_from_the_open(world, transport, paths, at):
    """As `look_ahead`, of paths in the open, which baked surfaces may turn: `TURNED` less its number is their body then."""
    surface = world.trace(paths.origin[at], paths.direction[at], np.inf)
    comes_in, turned, first = far.meetings(transport.surfaces, paths, at, surface)
    off = paths.sphere[at, 0] == OFF
    paths.sphere[at, 0] = UNKNOWN
    away = off & ~np.isfinite(comes_in).any(axis=1)
    paths.far[at[away]], paths.body[at[away]], paths.beyond[at[away]] = surface[away], -1, -1
    at, off, surface, turned, first = (values[~away] for values in (at, off, surface, turned, first))
    skipped = np.where(off, first, 0.0)
    paths.origin[at] += skipped[:, None] * paths.direction[at]
    surface, turned = surface - skipped, turned - skipped[:, None]
    if len(transport.bodies) == 1:
        paths.far[at], paths.body[at] = surface, 0
    else:
        entries = np.where(np.isfinite(turned), turned, _entries(transport, paths, at, surface))
        _choose(paths, at, surface, entries, np.ones(len(at), bool))
    inside = np.flatnonzero(paths.body[at] >= 0)
    body = paths.body[at[inside]]
    distance = turned[inside, body]
    rows = np.isfinite(distance)
    paths.far[at[inside[rows]]], paths.body[at[inside[rows]]] = distance[rows], TURNED - body[rows]


def _entries(transport, paths, at, limit, anew=None):
    """(m, bodies) m, to where paths come into each body before a limit (m,); of their own body, into its mesh again.

    anew : (m,) which choose their body anew: to the only one among whose grains they may come it is 0 m, as its own loop looks
        where they meet a grain, if any; None: of all it is told
    """
    t = np.full((len(at), len(transport.bodies)), np.inf)
    grains, current = paths.technique[at] == GRAINS, paths.body[at]
    ways = paths.origin[at], paths.direction[at], limit
    comes = grains[:, None] & (current[:, None] != np.arange(len(transport.bodies)))
    if anew is not None:
        for body, possible in enumerate(comes.T):
            if len(rows := np.flatnonzero(possible)):
                comes[rows, body] = transport.interactor(body, GRAINS).reached(*(values[rows] for values in ways))
        alone = anew & (comes.sum(axis=1) == 1)
        t[comes & alone[:, None]] = 0.0
        comes[alone] = False
    for body in range(len(transport.bodies)):
        for technique, inside, mine in ((GRAINS, True, comes[:, body]), (MEDIUM, True, ~grains & (current != body)),
                                        (MEDIUM, False, ~grains & (current == body))):
            if len(rows := np.flatnonzero(mine)):
                t[rows, body] = transport.interactor(body, technique).entry(*(values[rows] for values in ways), inside)
    return t


def _choose(paths, at, surface, entries, anew):
    """Puts paths `at` that choose anew (m,) into the body that comes first; far and beyond are what comes next."""
    rows = np.arange(len(at))
    first = np.argmin(entries, axis=1)
    enters = anew & np.isfinite(entries[rows, first])
    paths.body[at[anew]] = np.where(enters, first, -1)[anew]
    entries[rows[enters], first[enters]] = np.inf
    following = np.argmin(entries, axis=1)
    t = entries[rows, following]
    paths.far[at], paths.beyond[at] = np.minimum(t, surface), np.where(t < surface, following, -1)


def into_next(world, transport, paths, at):
    """Which of the paths `at` that leave their body go on into another one, and puts them there."""
    onward = np.zeros(len(at), bool)
    if len(transport.bodies) == 1 or not len(at):
        return onward
    ask = np.isnan(paths.far[at]) | (paths.beyond[at] >= 0)
    asked = at[ask]
    surface = world.trace(paths.origin[asked], paths.direction[asked], np.inf)
    every = np.ones(len(asked), bool)
    entries = _entries(transport, paths, asked, surface, every)
    onward[ask] = np.isfinite(entries).any(axis=1)
    _choose(paths, asked, surface, entries, every)
    moved = at[onward]
    paths.sphere[moved], paths.triangle[moved] = UNKNOWN, -1
    return onward
