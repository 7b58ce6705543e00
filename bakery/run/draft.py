"""What is known of a recipe's medium before it is baked: by a bake that is only as good as a decision needs."""

import os
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from bakery.plan.asked import Asked
from bakery.run import execute, prepare
from bakery.run.cache import Cache
from bakery.run.progress import Progress
from bakery.store import scratch

# Rules have margins of a quarter.  Of particles coefficients are then known to 1 %, a single angle to some percent; takes 0.5 to
# 2.7 s of one core for eight wavelengths and spheres to 5 mm, of which choosing rays would be the larger part
DRAFT = {"tolerance": "30%", "measure": "integrated"}
OF_PARTICLES = {"phase.radii": "33", "phase.angles": "257"}


class Medium(NamedTuple):
    """A continuous medium at L wavelengths."""

    wavelength: np.ndarray  # (L,) um
    sigma_t: np.ndarray  # (L,) 1/m
    # albedo, g: (L,) 1
    albedo: np.ndarray
    g: np.ndarray
    theta: np.ndarray  # (A,) rad
    phase: np.ndarray  # (L, A) 1/sr


def medium(recipe, settings: Mapping[str, str], cache: Cache, progress: Progress | None = None) -> Medium:
    """The medium of a checked recipe, loaded with some overrides, by a draft bake whose stages stay in the cache.

    Raises RecipeError, UsageError, StageError, StoreError : see `bakery.errors`
    """
    import bakery
    from bakery.recipe import load

    progress, name = progress or Progress(), os.path.basename(recipe.path)
    draft = DRAFT | ({} if recipe.particles is None else OF_PARTICLES)
    if recipe.particles is not None and recipe.phase.method == "auto":
        draft["phase.method"] = "mie"
    with scratch.folder("draft") as folder:
        coarser = load(recipe.path, {**settings, **draft})
        plan = prepare(coarser, folder / "draft.h5", asked=Asked(stages=("medium",)), cache=cache)
        with progress.during(f"measuring the medium of {name}"):
            asset = bakery.open(execute(plan, cache=cache).output)
    baked = asset.medium
    return Medium(*(np.array(value, float) for value in (asset.wavelength, baked.sigma_t, baked.albedo, baked.g, baked.theta,
                                                         baked["phase"])))
