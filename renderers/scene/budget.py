"""How the tolerance of a picture is shared out.

The tolerance is the relative root mean square error of linear radiance.  Errors of different origin do not know of each other, so
they add up in squares: approximations of the renderer have what their method states; what they leave is shared between the
tables of the asset and noise.  Finer tables take longer to bake, less noise longer to render; of some splits the one that takes
least in all is chosen.  The time of tables is that of the plan; that of noise goes by what such pictures take a pixel, measured
once and for all: a clock must not decide what is baked, or two machines would bake different assets of one scene.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from renderers.scene import entries

DEFAULT = 0.05  # tolerance of scenes that say none
# Squares of the error of tables over what approximations leave.  Tables never have more than half: a scene that names a ready
# asset is rendered as if they had half, whatever it was baked for
HALF = 0.5
ROOM = 0.5  # of a tolerance, that a method which `auto` takes may be off by; in squares a quarter
SHARES = HALF, 1 / 4, 1 / 8
# Error of one pixel over the root mean square error of all, by tables: 4.0 in the rainbow of tests/adversarial.py, at most 1.1 in
# others
GATHERED = 4.0


class Split(NamedTuple):
    """Errors that parts of a picture may have, relative to its mean (of `measure: pixels`, to a pixel, see docs/requirements.md).

    tolerance : of the picture
    approximations : of the renderer's method
    tables : of the asset
    noise : standard error
    share : of the tables, in squares, of what approximations leave
    why : of the tables' share, in words; "" where nothing was compared
    """

    tolerance: float
    approximations: float
    tables: float
    noise: float
    share: float = HALF
    why: str = ""

    @property
    def lacking(self) -> tuple[str, ...]:
        """What is to be said where the method's own error leaves no room, so that no noise keeps the tolerance."""
        if self.approximations < self.tolerance:
            return ()
        together = math.hypot(self.approximations, self.tables, self.noise)
        return (f"the method's own error of {percent(self.approximations)} leaves the tolerance of {percent(self.tolerance)} out "
                f"of reach, {as_much(self.approximations / self.tolerance)}; with noise and tables that is {percent(together)}",)


def of(scene, share: float | None = None, approximations: float | None = None) -> Split:
    """The split of a scene where tables have a share of what approximations leave; all that a noise leaves which it gives.

    scene : `renderers.scene.Scene`
    share : 1, of squares; that which its assets were baked for if None.  Without meaning where the scene gives the noise
    approximations : error of the method where it was measured; what it declares if None

    Where the method's own error is above the tolerance no split keeps it, and `lacking` says so: then noise and tables have the
    tolerance between them, as less of them would not help.
    """
    values, share = scene.values, scene.share if share is None else share
    tolerance, noise = values.tolerance or DEFAULT, values.stop.noise
    if approximations is None:
        of_kind = scene.renderer in entries.PACKAGES.values()
        approximations = entries.declared(values.materials[0].kind)[values.method].error(tolerance) if of_kind else 0.0
    remaining = tolerance**2 - approximations**2
    remaining = remaining if remaining > 0 else tolerance**2
    if noise is None:
        tables, noise = math.sqrt(share * remaining), math.sqrt((1 - share) * remaining)
    else:
        unspent = remaining - noise**2
        tables = math.sqrt(unspent if unspent > SHARES[-1] * remaining else HALF * remaining)
    return Split(tolerance, approximations, tables, noise, share)


def cheapest(scene, pixels: int, pace: float, seconds: Callable[[Split], float]) -> Split:
    """The split that takes least time, of `SHARES`.

    scene : `renderers.scene.Scene`
    pixels : of the picture
    pace : s, of one core, that one pixel takes to a relative variance of 1
    seconds : what baking takes with a split, of one core; inf where no tables are as good
    """
    limit = scene.values.stop.time or math.inf

    def rendering(split):
        return min(pixels * pace / split.noise**2, limit)

    splits = [of(scene, share) for share in reversed(SHARES)]
    if scene.values.stop.noise is not None or rendering(splits[0]) == limit:
        return splits[-1]
    best, least = None, math.inf
    for candidate in splits:
        # to know what a bake takes takes a while: not asked where noise alone takes as long
        if rendering(candidate) < least and (took := seconds(candidate) + rendering(candidate)) <= least:
            best, least = candidate, took
    if math.isinf(least):
        return splits[-1]
    return best._replace(why=f"baking takes about {least - rendering(best):.2g} s and noise {rendering(best):.2g} s of a core "
                             "then, of three splits the least")


def percent(share: float) -> str:
    """A share in words, of two figures or all before the point: 2.2 %, 110 %."""
    return f"{_figures(100 * share)} %"


def as_much(times: float) -> str:
    """A factor in words, as above: 2.2 times as much, 110 times as much."""
    return f"{_figures(times)} times as much"


def _figures(number) -> str:
    return f"{number:.0f}" if number >= 99.5 else f"{number:.2g}"
