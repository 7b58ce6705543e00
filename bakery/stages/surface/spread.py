"""How far from where it went in light comes out of a layer: walks for each wavelength and thickness, arrays, look-ups."""

import math

import numpy as np

from bakery.stages.declaration import Output

_PAIR = "by class of incidence and of exitance (thirds of the square of the sine, from the normal)"
OUTPUTS = (
    Output("spread_radius", "(L, T, S)", "um", "farther ends of bins of the distance between where light goes in and where it "
           "comes out; the first begins at 0", optional=True),
    Output("spread", "(L, T, K, K, S)", "1", f"share of the light of a class that comes out in each bin, {_PAIR}; mirrored light "
           "left out", optional=True),
    Output("spread_error", "(L, T, K, K, S)", "1", "standard error of spread", optional=True),
    Output("spread_square", "(L, T, K, K)", "um^2", f"mean squared distance of light that comes out within the last bin, {_PAIR}",
           optional=True),
    Output("spread_square_error", "(L, T, K, K)", "um^2", "standard error of spread_square", optional=True),
    Output("mean_square", "(L, T)", "um^2", "the same of light from all sides to all sides", optional=True),
    Output("mean_square_error", "(L, T)", "um^2", "standard error of mean_square", optional=True),
    Output("beyond", "(L, T)", "1", "share of the light from all sides that comes out further away, or has been as deep",
           optional=True, within=(0, 1)),
    Output("profile", "(L, T)", "um", "d of the nearest profile (exp(-r/d) + exp(-r/(3 d))) / (8 pi d r) of Burley and "
           "Christensen", optional=True),
    Output("profile_misfit", "(L, T)", "1", "largest difference between its share within a distance and what comes out there",
           optional=True, within=(0, 1)),
)
NAMES = tuple(output.path for output in OUTPUTS)


def spread_of(slab, tolerance: float, seed: int, wave: int, layer: int):
    """Of a layer at a wavelength: a task that any worker may run.

    tolerance : of the root mean square distance: 1 % at best without end, 2 % of a thickness, where far light is dearer
    """
    from bakery.physics.surfaces.slab import layers
    from bakery.physics.surfaces.spread import COARSEST, TOLERANCE, spread

    finest = TOLERANCE if layers(slab)[0][-1].depth == math.inf else 2 * TOLERANCE
    return spread(slab, seed, wave, layer, tolerance=min(max(2 * tolerance, finest), COARSEST))


def has_spread(slab) -> bool:
    """Whether walks can tell it: not among grains, nor in layers of assets that do not say how long their paths are."""
    from bakery.physics.surfaces.slab import Reflector, layers

    parts, bottom = layers(slab)
    return not isinstance(bottom, Reflector) and all(math.isfinite(part.length) for part in parts)


def stored(spreads: list, shape: tuple[int, int]) -> dict:
    """Arrays of the group, of `bakery.physics.surfaces.spread.Spread`s, wavelength by wavelength."""
    from bakery.physics.surfaces.spread import profile

    profiles = np.array([profile(walked.edges, walked.light.mean(axis=0).sum(axis=0), walked.beyond) for walked in spreads])
    across = {"spread": [walked.light for walked in spreads], "spread_error": [walked.light_error for walked in spreads]}
    values = {name: np.stack(parts).astype(np.float32) for name, parts in across.items()}
    values["spread_radius"] = np.stack([walked.edges[1:] for walked in spreads])
    for name, part in (("spread_square", "square"), ("spread_square_error", "square_error"), ("mean_square", "mean_square"),
                       ("mean_square_error", "mean_square_error")):
        values[name] = np.stack([np.asarray(getattr(walked, part)) for walked in spreads])
    values |= {"beyond": np.clip([walked.beyond for walked in spreads], 0, 1), "profile": profiles[:, 0],
               "profile_misfit": profiles[:, 1]}
    return {name: value.reshape(*shape, *value.shape[1:]) for name, value in values.items()}


def length(sigma_t: float, width: float) -> float:
    """um, `Slab.length` of a layer; sigma_t 1/m, width um, may be infinite."""
    if sigma_t > 0 and width > 0:
        return 1e6 / sigma_t
    return width if width < math.inf else 1.0


def within(radius_of, light, beyond, radius):
    """Share (L, T, ...) of the light that comes out within distances; between the ends of bins in proportion.

    radius_of, light : (L, T, S);  beyond : (L, T);  radius : um, any shape
    """
    radius = np.asarray(radius, float)
    shares = np.empty((*light.shape[:2], *radius.shape))
    for at in np.ndindex(light.shape[:2]):
        total = light[at].sum() + beyond[at]
        cumulated = np.concatenate([[0.0], np.cumsum(light[at])]) / total if total > 0 else np.zeros(light.shape[2] + 1)
        shares[at] = np.interp(radius, np.concatenate([[0.0], radius_of[at]]), cumulated)
    return shares
