"""Periodic tiles of hard spheres that do not overlap, from dilute to jammed: `pack`.

Event-driven growth of moving spheres (Lubachevsky & Stillinger 1990).  Range, method and measured figures: docs/packing.md.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from bakery.rng import generator

EQUILIBRIUM = 0.5  # up to here (freezing begins at 0.494) a tile is a fluid in equilibrium, above it is what growth left behind
JAMMED = 1e6  # reduced pressure at which growth is pointless
ATTEMPTS = 3
GAP_MAX = 1e-10  # of the mean diameter: overlap that cannot be rounding
COUNT_MAX = 1_000_000
FRACTION_MIN = 1e-6
_START = 0.28  # random sequential addition is quick up to here (it ends at 0.384)
_ORDERED_FROM, _ORDERED_COUNT = 0.48, 64  # fraction and number of spheres from which bond order is looked at
_BUDGET = 20_000  # collisions a sphere and attempt
_LIGHT = 20  # events a collision that no run of growth comes near to; of a dilute one most are bubbles left


@dataclass(frozen=True)
class Schedule:
    """How a tile is made."""

    # (until fraction, rate) in order; rate = d(mean diameter)/dt over the thermal speed.  The fractions are those of equal
    # spheres and are stretched with `limit` for others
    growth: tuple[tuple[float, float], ...]
    equilibrate: float  # collisions a sphere at fixed size, for fractions up to 0.5
    # fraction (of equal spheres) that this growth still reaches with room to spare; denser tiles take `SCHEDULES["final"]`
    top: float = 1.0


# Slow where the fluid becomes a glass (0.55 ... 0.62): that decides how dense it jams.  Later growth only closes gaps.
SCHEDULES = {
    "draft": Schedule(((0.5, 0.4), (0.6, 0.05), (1.0, 0.1)), 50.0, 0.62),
    "preview": Schedule(((0.5, 0.2), (0.56, 0.05), (0.6, 0.01), (1.0, 0.05)), 75.0, 0.632),
    "final": Schedule(((0.5, 0.2), (0.55, 0.04), (0.62, 0.008), (1.0, 0.02)), 100.0),
}


@dataclass(frozen=True)
class Packing:
    """A periodic tile, in units of the mean radius, and how it came about."""

    centers: np.ndarray  # (N, 3) in [0, cell)
    radii: np.ndarray  # (N,) in the caller's order, mean 1
    cell: np.ndarray  # (3,)
    fraction: float  # volume of the spheres over that of the cell, as reached
    wished: float  # as requested
    reached: bool  # whether they agree
    status: str  # "reached", "jammed", "budget" or "crystal"
    reason: str  # in words, "" if reached
    pressure: float  # Z = PV/NkT over the last window; nan for one sphere
    order: float  # bond order Q6 over all bonds; nan where it is not looked at (below fraction 0.48 or 64 spheres)
    # smallest gap over the mean diameter, by a search that shares nothing with the dynamics; at least 0 up to rounding
    gap: float
    shrink: float  # relative amount by which the radii were shrunk against rounding; the fraction is that after it
    # collisions, events, attempts: of all attempts together
    collisions: int
    events: int
    attempts: int


def pack(fraction, radii, cell=(1.0, 1.0, 1.0), *, seed, stream=0, schedule="final",
         report: Callable[[float, float, float], None] | None = None, budget=None) -> Packing:
    """Pack spheres at random into a periodic cuboid.

    fraction : of the volume that the spheres fill; 1e-6 to `limit(radii)`
    radii : (N,) relative, 1 to 1e6 spheres
    cell : (3,) proportions of the cell's edges
    seed, stream : whole numbers >= 0; the same ones give the same bytes
    schedule : a name in `SCHEDULES` or a `Schedule`
    report : called with fraction, reduced pressure and the share of the work that is done, several times a second and from the
        calling thread; an exception that it raises, or an interrupt, ends the work
    budget : collisions a sphere after which an attempt ends

    Returns Packing : up to fraction 0.5 a fluid in equilibrium; above, the random packing that growth leads to.  Where the
        spheres jam short of the requested fraction (tried again with slower growth) or order themselves (tried again from another
        start), `reached` is False and the densest disordered attempt is returned
    Raises ValueError : before any work: a fraction out of range, a cell so thin that a sphere would meet its own image

    The fraction is exact to rounding.  Source: Skoge, Donev, Stillinger & Torquato, Phys. Rev. E 74, 041127 (2006), section II.

    >>> tile = pack(0.3, [1.0] * 100, seed=1, schedule="draft")
    >>> round(tile.fraction, 12), tile.gap >= 0
    (0.3, True)
    """
    from bakery.physics.packing.ceiling import limit

    radii, edges = _checked(fraction, radii, cell, limit)
    target = float(fraction)
    if radii.size == 1:
        return Packing(0.5 * edges[None], radii, edges, target, target, True, "reached", "", np.nan, np.nan,
                       float(0.5 * edges.min() - 1.0), 0.0, 0, 0, 1)
    stretch = limit(radii) / limit(np.ones(2))
    plan = _schedule(schedule, target / stretch)
    best, collisions, events = None, 0, 0
    for attempt in range(ATTEMPTS):
        rng = generator(seed, "packing.centers", stream, attempt)
        tile = _attempt(target, radii, edges, plan, stretch, rng, report, budget or _BUDGET)
        collisions, events = collisions + tile.collisions, events + tile.events
        if best is None or _merit(tile) > _merit(best):
            best = tile
        if tile.reached:
            break
        if tile.status == "jammed":  # slower growth jams later
            plan = replace(plan, growth=tuple((until, 0.5 * rate) for until, rate in plan.growth))
    return replace(best, collisions=collisions, events=events, attempts=attempt + 1)


def predicted(fraction, count, spread=0.0, schedule="final") -> float:
    """Seconds of one core that `pack` takes, within a factor of two.

    fraction : requested
    count : spheres
    spread : standard deviation over mean of the radii
    schedule : as for `pack`

    Collisions from the pressure of the fluid and of a packing that jams, times what one takes: measured on one machine
    (docs/packing.md); the kernels' first compilation (10 s) is not in it.
    """
    if count == 1:
        return 1e-3
    stretch = 1.0 + 0.15 * spread  # of the densest fraction, roughly: `limit` needs the radii themselves
    plan = _schedule(schedule, fraction / stretch)
    collisions = _collisions(fraction / stretch, plan, count)
    bubbles = max(0.47 * fraction**-0.65 - 0.6, 0.0)  # bubbles left a collision: 0.13 at 0.5, 2.1 at 0.1, 43 at 0.001
    microseconds = (0.36 + 0.25 * spread + 1.7 * bubbles) * (1.0 + 0.4 * max(np.log10(count / 1e4), 0.0))  # a collision
    return 0.01 + 1e-6 * count * (microseconds * collisions + 60.0)


def _checked(fraction, radii, cell, limit):
    """Radii with mean 1 and the cell's edges, or a ValueError that names what is wrong and what would do."""
    radii, cell = np.asarray(radii, float), np.asarray(cell, float)
    if radii.ndim != 1 or not 1 <= radii.size <= COUNT_MAX:
        raise ValueError(f"radii of shape {radii.shape}: one radius a sphere is needed, 1 to {COUNT_MAX} of them")
    if not (np.all(np.isfinite(radii)) and radii.min() > 0):
        raise ValueError("radii must be positive and finite")
    if cell.shape != (3,) or not (np.all(np.isfinite(cell)) and cell.min() > 0):
        raise ValueError(f"cell {cell.tolist()}: three positive proportions are needed")
    if not FRACTION_MIN <= fraction < 1:
        raise ValueError(f"fraction {fraction:g}: {FRACTION_MIN:g} to {limit(radii):.3g} are possible")
    top = limit(radii)
    if fraction > top + 1e-12:
        kind = "equal spheres" if np.ptp(radii) <= 1e-9 * radii.max() else "spheres of these sizes"
        advice = "; ask for several sizes of spheres to fill more" if kind == "equal spheres" else ""
        raise ValueError(f"fraction {fraction:g}: {kind} at random reach {top:.3g}{advice}")
    radii = radii / radii.mean()
    edges = cell * (4 / 3 * np.pi * np.sum(radii**3) / (fraction * np.prod(cell))) ** (1 / 3)
    diameter = 2 * radii.max()
    if edges.min() <= diameter * (1 + 1e-6):
        need = (diameter / edges.min()) ** 3 * radii.size
        raise ValueError(
            f"the cell's edge {'xyz'[int(edges.argmin())]} is {edges.min():.4g} mean radii, but the largest sphere has a "
            f"diameter of {diameter:.4g} and would meet its own image: take more spheres (over {int(need)}), a smaller fraction, "
            "or a cell that is less thin")
    return radii, edges


def _schedule(schedule, fraction) -> Schedule:
    """The schedule itself, of a name too; a denser tile than it is made for takes the slowest."""
    if isinstance(schedule, str):
        if schedule not in SCHEDULES:
            raise ValueError(f"schedule {schedule!r}: known are {', '.join(SCHEDULES)}")
        schedule = SCHEDULES[schedule]
    return schedule if fraction <= schedule.top else replace(schedule, growth=SCHEDULES["final"].growth)


def _pause(fraction, plan) -> float:
    """Collisions a sphere at fixed size: fewer where spheres fly far between two, and addition at random is nearly a fluid."""
    return plan.equilibrate * min(1.0, 0.02 + 0.98 * fraction / 0.1) if fraction <= EQUILIBRIUM else 0.0


def _attempt(fraction, radii, edges, plan, stretch, rng, report, budget):
    """One start, growth and rest."""
    from bakery.physics.packing import structure
    from bakery.physics.packing.dynamics import OutOfBudget, Spheres

    descending = np.argsort(-radii, kind="stable")
    expected = max(_collisions(fraction / stretch, plan, radii.size) * radii.size, 1.0)

    def tell(spheres):
        if report is not None:
            report(min(spheres.fraction, fraction), spheres.pressure, min(spheres.collisions / expected, 0.99))

    spheres = Spheres(radii[descending], edges, rng, tell)
    pause = _pause(fraction, plan)
    status, reason = "reached", ""
    try:
        spheres.budget = int(budget * radii.size * _LIGHT) + 1_000_000, int(budget * radii.size)
        spheres.place(min(_START, fraction))
        for until, rate in plan.growth:
            if not spheres.grow(min(until * stretch, fraction), rate, JAMMED):
                status = "jammed"
                reason = f"jammed at {spheres.fraction:.6g}, reduced pressure {spheres.pressure:.3g}"
                break
        else:
            if pause:
                spheres.rest(pause)
    except OutOfBudget:
        status = "budget"
        reason = f"stopped at {spheres.fraction:.6g} after {spheres.collisions / radii.size:.0f} collisions a sphere"
    complete = status == "reached"
    scale = 1.0 if complete else spheres.scale  # radii become those asked for, so the cell of what is smaller grows
    centers, edges = np.empty((radii.size, 3)), edges / scale
    centers[descending] = spheres.places / scale
    gap, shrink = structure.smallest_gap(centers, radii, edges), 0.0
    if gap < -GAP_MAX:
        raise AssertionError(f"spheres overlap by {-gap:g} of the mean diameter after {spheres.collisions} collisions")
    while gap < 0:  # rounding
        step = -2 * gap / radii.min() + 1e-16
        centers, edges, shrink = centers * (1 + step), edges * (1 + step), shrink + step
        gap = structure.smallest_gap(centers, radii, edges)
    centers[centers >= edges] = 0.0
    order = np.nan
    if fraction >= _ORDERED_FROM and radii.size >= _ORDERED_COUNT:
        order = structure.global_bond_order(centers, radii, edges)
        if order > 3.0 / np.sqrt(radii.size) + 0.03:  # at random 1.1/sqrt(N), standard deviation 0.25/sqrt(N)
            status, reason = "crystal", f"ordered itself: bond order Q6 {order:.3g}, at random {1.1 / np.sqrt(radii.size):.2g}"
    return Packing(centers, radii, edges, fraction if complete and not shrink else structure.fraction(radii, edges), fraction,
                   status == "reached", status, reason, float(spheres.pressure), float(order), gap, shrink, spheres.collisions,
                   int(spheres.tally.sum()), 1)


def _merit(tile):
    """Order of preference among attempts."""
    return tile.reached, tile.status != "crystal", tile.fraction


def _collisions(fraction, plan, count) -> float:
    """Collisions a sphere of growth and rest: 3 (Z-1)/(sqrt(pi) d) a time at thermal speed 1, integrated over the growth.

    Z of Carnahan and Starling, or 3/(1 - f/f_J) where that is more; the spheres warm up by 10 % in speed before each rescaling.
    """
    total, low = _pause(fraction, plan), min(_START, fraction)
    slow = min(rate for until, rate in plan.growth)
    jammed = max(0.645 - 0.012 * np.log10(slow / 0.01), fraction + 1e-4)
    for until, rate in plan.growth:
        high = min(until, fraction)
        if high > low:
            f = low + (high - low) * (np.arange(200) + 0.5) / 200
            pressure = np.maximum((1 + f + f**2 - f**3) / (1 - f) ** 3, 3 / (1 - f / jammed))
            total += 1.1 * np.mean(0.564 * (pressure - 1) / (f * rate)) * (high - low)
            low = high
    return total
