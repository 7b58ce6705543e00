"""Cross sections and phase functions averaged over a size distribution, refined until a tolerance is met.

The error that counts is pointwise: at every stored angle, the change of the averaged intensity when the nodes are halved,
relative to the intensity itself (Mueller elements: to S11), and the same for each mean cross section (`cross` says what that
means for absorption).  Where rays stand for series, their own error counts apart, as an integrated difference (`choice`).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from bakery.errors import StageError
from bakery.physics.averages.batches import solve
from bakery.physics.averages.choice import Choice, at_once, choose
from bakery.physics.averages.cross import SHARE, cross_sections
from bakery.physics.averages.predicted import predict, predicted_angles
from bakery.physics.averages.spheres import Aim, Coat, Component, Rays, channels_of, features_of
from bakery.physics.averages.work import Work
from bakery.physics.medium import grid, phase
from bakery.physics.sizes.nodes import COARSE, SPARSE
from bakery.physics.tasks import in_turn

__all__ = ["Aim", "Average", "Coat", "Component", "Rays", "averages", "expected", "first_grid"]

_RIPPLE = 0.03  # steps of this over x are a hundredth of a ripple
_TRIES = 4
_WIDER = 4.0  # sparse steps between angles over others, which suit 1 %: linear interpolation misses by the square
_MARGIN = 0.8  # of the tolerance, for quadrature (its SHARE) and interpolant together; the rest is the normalisation's


@dataclass(frozen=True)
class Average:
    """Averages of one component."""

    name: str
    # radius, weight: (R,) um, 1; quadrature nodes of the cross sections, weights add up to 1
    radius: np.ndarray
    weight: np.ndarray
    # scattering, absorption: (L, R) um^2
    scattering: np.ndarray
    absorption: np.ndarray
    cosine: np.ndarray  # (L, R) 1, mean cosine of each sphere
    elements: np.ndarray  # (L, E, A) 1/sr; the phase function, and with polarisation S12, S33, S34 in the same unit (E = 1 or 4)
    phase_bias: np.ndarray  # (L, A) 1/sr, absolute, quadrature, interpolation and rays next to the angle, for all elements
    # (L,) 1, the largest relative error of phase function and mean cross sections (absorption as said above), rays apart
    error: np.ndarray
    absorption_bias: np.ndarray  # (L,) 1, relative change of the mean absorption alone
    scale: np.ndarray  # (L,) 1, integral of the phase function before it was normalised, over the mean scattering cross section
    # (L,) of `choice.Choice`; from which size parameter on rays were taken, and their measured error
    choices: tuple[Choice, ...] = ()


def averages(components: Sequence[Component], wavelength, host, aim: Aim,
             map: Callable = in_turn,
             report: Callable[[float, float | None], None] = lambda seconds, error: None, *,
             remember: Callable = at_once, expectation=None) -> tuple[np.ndarray, list[Average]]:
    """Averages of all components at all wavelengths on one grid of angles.

    Parameters
    ----------
    components : with indices m (L,)
    wavelength : (L,) um, in vacuum
    host : (L,) real index of the host
    aim : how good they are to be
    map : `map(function, tasks)` -> list in the order of the tasks
    report : called with the work that is done, in seconds as predicted for one core, and the error reached
    remember : of choices of rays, as in `choice.choose`
    expectation : what `expected` gives for the same arguments, where it is known already

    Returns
    -------
    theta : (A,) rad, ascending from 0 to pi
    averages : one for each component

    Raises
    ------
    StageError : the tolerance would take too many angles or hours

    Notes
    -----
    Where no number of sizes meets the tolerance, `error` says what was reached with the most that are tried.

    Spheres of one size have interference minima of any depth, in which a relative error means nothing; for them (one part, x > 5,
    x times relative width < 3) the reference is the largest value within half a ripple, pi/(2x).
    """
    prediction, channels, choices = expectation or expected(components, wavelength, host, aim, remember=remember)
    k = np.array([channel.k for channel in channels[: len(np.asarray(wavelength))]])
    work = Work(map, report)
    work.expect(prediction)
    crosses = [cross_sections(c, channel.nodes, np.asarray(wavelength), k, aim.tolerance, work)
               for c, channel in zip(components, channels[:: len(k)])]
    table, finished = _Tables(channels, choices, crosses, aim, work).solved()
    spectra = (slice(i * len(k), (i + 1) * len(k)) for i in range(len(components)))
    return table.theta, [_average(component, cross, finished[part], choices[part])
                         for component, cross, part in zip(components, crosses, spectra)]


@dataclass(frozen=True)
class _Tables:
    """What is to be tabulated, on one grid of angles; arguments as of `averages`."""

    channels: Sequence
    choices: Sequence[Choice]
    crosses: Sequence
    aim: Aim
    work: Work

    def solved(self):
        """The refined table, and of each channel what `_finish` gives."""
        tolerance, integrated, aim = self.aim.tolerance, self.aim.integrated, self.aim
        margin = math.inf if aim.angles else (_MARGIN - SHARE if integrated else _MARGIN) * tolerance
        target = math.inf if aim.radii else SHARE * tolerance
        if integrated and any(choice.taken for choice in self.choices):
            # nothing else bounds the integral of a table by rays: what it misses counts twice (`_finish`)
            margin, target = margin / 2, target / 2
        theta, earlier = first_grid(self.channels, tolerance, aim.angles, aim.sparse), None
        for _ in range(_TRIES):
            table = self._refined(theta, margin, target, earlier)
            finished = self._finished(table)
            if aim.angles or aim.radii or self.work.unfinished or all(error <= tolerance for *_, error in finished):
                break
            # the normalisation, or angles between the first ones, took more than their share: leave more room
            if integrated:
                margin, target = 0.7 * margin, 0.7 * target
            else:
                theta, margin, earlier = table.theta, 0.85 * margin, (table.values, table.error, table.tag)
        return table, finished

    def _refined(self, theta, margin, target, earlier):
        switches, aim = [choice.switch for choice in self.choices], self.aim

        def evaluate(new, floor):
            return solve(self.channels, switches, new, floor, target, aim.polarized, aim.rays, self.work, aim.integrated)

        try:
            return grid.refine(theta, evaluate, margin, _ripples(self.channels), earlier,
                               finest=_finest(self.channels, self.choices, aim.peaks), most=0.0 if aim.radii else target,
                               integrated=aim.integrated)
        except grid.TooManyAngles:
            raise StageError(_too_many(self.channels, aim.tolerance)) from None

    def _finished(self, table):
        spectrum = len(self.channels) // len(self.crosses)
        s11, was = phase.normalised(table.theta, table.values[:, 0])
        shift = _shift(table.theta, table.values[:, 0], table.between)
        return [_finish(table, i, (s11[i], was[i], float(shift[i])), channel, self.choices[i],
                        self.crosses[i // spectrum], i % spectrum, self.aim.integrated)
                for i, channel in enumerate(self.channels)]


def _ripples(channels):
    """(C,) rad, distance of neighbouring crests of the ripples of equal spheres; 0 where there are none."""
    features = map(features_of, channels)
    return np.array([math.pi / (2 * x) if len(parts) == 1 and x > 5 and x * width < 3 else 0.0
                     for parts in features for x, width in parts[:1]])


def _finest(channels, choices, peaks):
    """rad, of the narrowest cell: rays jump here and there by less than their error; nothing that a sphere scatters is narrower
    than its ripples.  peaks : as in `spheres.Aim`."""
    ripples = [_RIPPLE / (c.k * c.nodes.span()[1]) for c, choice in zip(channels, choices) if choice.taken]
    return (min if peaks else max)(ripples, default=0.0)


def _average(component, cross, spectrum, choices):
    """The average of a component, from what `_finish` gives at each wavelength."""
    elements, bias, scale, error = zip(*spectrum)
    return Average(component.name, cross.radius, cross.weight, cross.scattering, cross.absorption, cross.cosine,
                   np.array(elements), np.array(bias),
                   np.array([max(e, float(of_cross)) for e, of_cross in zip(error, cross.all_error)]),
                   cross.absorption_bias, np.array(scale), tuple(choices))


def expected(components, wavelength, host, aim: Aim, *, remember=at_once):
    """What `averages` with these arguments will take, before it runs.

    Returns
    -------
    prediction : `predicted.Prediction`
    channels, choices : each component at each wavelength, component by component, and where rays are taken in it (measured here)
    """
    steps = None if not aim.integrated else SPARSE if aim.sparse else COARSE
    channels = channels_of(components, wavelength, host, aim.tolerance, aim.radii, steps)
    choices = choose(channels, aim.tolerance, aim.rays, remember)
    return predict(channels, choices, aim), channels, choices


def first_grid(channels, tolerance, count=None, sparse=False):
    """First angles for all channels together; StageError where the predicted number of angles is beyond the limit.

    With `count` so many angles, spread like the first ones; `sparse` as in `spheres.Aim`.
    """
    if count is None and predicted_angles([f for c in channels for f in features_of(c)], tolerance) > grid.LIMIT:
        raise StageError(_too_many(channels, tolerance))
    features = sorted({f for c in channels for f in features_of(c)})
    bows = [(angle, x ** (-2 / 3)) for c in channels for x, _ in features_of(c) if x > 20 for angle in grid.bows(c.m.real)]
    try:
        theta = grid.start(features, bows, _WIDER if sparse else 1.0)
    except grid.TooManyAngles:
        raise StageError(_too_many(channels, tolerance)) from None
    if count is None:
        return theta
    return np.interp(np.linspace(0, len(theta) - 1, count), np.arange(len(theta)), theta)


def _too_many(channels, tolerance):
    worst = max(channels, key=lambda c: predicted_angles(features_of(c), tolerance))
    x, width = max(features_of(worst), key=lambda f: predicted_angles([f], tolerance))
    cause = f"spheres of one size, x = {x:.3g}," if width == 0 else f"sizes of a relative width of {width:.2g} at x = {x:.3g}"
    count = predicted_angles([(x, width)], tolerance)
    return (f"{worst.component} at {worst.wavelength:g} um: {cause} scatter in ripples of "
            f"{math.degrees(math.pi / x):.2g} degrees, about {count:.2g} angles at a tolerance of {tolerance:g}, "
            f"and at most {grid.LIMIT:g} are stored; give the size a width (distribution: lognormal, sigma: 1.05) "
            "or take a larger tolerance")


def _finish(table, i, whole, channel, choice, cross, wavelength, integrated):
    """Normalised elements (E, A), absolute error (A,), integral before over C_sca, error of one channel in the measure asked.

    whole : the channel's normalised phase function, the integral that it had, and the bound of that integral's error
    """
    values, (s11, was, shift) = table.values[i], whole
    scattering = float(np.sum(cross.scattering[wavelength] * cross.weight))
    scale = float(was) / (channel.k**2 * scattering)
    factor = s11 / values[0]
    elements = np.concatenate([s11[None], values[1:] * factor])
    between = table.between[i]
    near = np.maximum(np.concatenate([between[:1], between]), np.concatenate([between, between[-1:]]))
    mean = shift
    if not choice.taken:  # series have the integral C_sca, rays only about
        shift = min(shift, abs(scale - 1) + float(cross.error[wavelength]))
    absolute = np.maximum(near / was, table.error[i] * s11) + shift * s11
    if choice.taken:
        absolute += np.interp(table.theta, choice.theta, choice.difference)
    return elements, absolute, scale, (mean if integrated else float(table.relative[i])) + shift


def _shift(theta, f, between):
    """(C,) bound of the relative error of the integral of a table f (C, A): the mean of the errors of its cells."""
    cells = phase.steps(theta)
    if len(theta) < 2:
        return np.zeros(len(f))
    return np.sum(between * cells, axis=-1) / np.sum((f[:, 1:] + f[:, :-1]) / 2 * cells, axis=-1)
