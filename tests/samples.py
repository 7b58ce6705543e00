"""A small asset made by hand, with everything that the format knows, and functions that corrupt it."""

import math

import numpy as np

from bakery.physics.medium.phase import cumulative, mean_cosine, normalised
from bakery.physics.medium.similarity import reduced
from bakery.store.container import USER_BLOCK, user_block
from bakery.store.hashes import seal
from bakery.store.image import image
from bakery.store.tree import Dataset, Group, text

# a recipe of small spheres whose polarisation other solvers see, too
POLARISED_DROPS = """\
bakery: 1
name: drops
wavelengths: [0.5, 0.55]
tolerance: 0.5%
phase: {polarized: true}
particles:
  number_density: 1e11 /m^3
  components:
    - {name: spheres, material: {n: 1.33}, size: {distribution: lognormal, radius: 100 nm, sigma: 1.4}}
"""


def small_asset() -> Group:
    """Two wavelengths, 60 radii, 400 angles: about 50 kB, of the shape that a bake of fog has.  Not sealed."""
    draw = np.random.default_rng(1).random
    theta = np.concatenate([[0.0], np.geomspace(1e-5, 1.0, 199) * math.pi])
    theta = np.union1d(theta, np.linspace(0, math.pi, 201))
    cosine = np.cos(theta)
    g = np.array([0.8, 0.7])
    phase, _ = normalised(theta, (1 - g[:, None] ** 2) / (1 + g[:, None] ** 2 - 2 * g[:, None] * cosine) ** 1.5)
    g = mean_cosine(theta, phase)
    radius, weight = np.geomspace(0.1, 60.0, 60), np.full(60, 1 / 60)
    scattering = 2 * math.pi * radius**2 * (1 + 0.05 * draw((2, 60)))
    absorption = 1e-3 * scattering
    optics = Group({"theta": Dataset(theta, "rad", "angle between the directions of travel"), "droplets": Group({
        "radius": Dataset(radius, "um", "radii of the quadrature"),
        "weight": Dataset(weight, "1", "share of the number of particles"),
        "mean_volume": Dataset(np.array([4 / 3 * math.pi * (radius**3 @ weight)]), "um^3", "mean volume of a particle"),
        "extinction": Dataset(scattering + absorption, "um^2", "extinction cross section"),
        "scattering": Dataset(scattering, "um^2", "scattering cross section"),
        "absorption": Dataset(absorption, "um^2", "absorption cross section"),
        "scattering_error": Dataset(1e-4 * scattering, "um^2", "standard error of scattering"),
        "method": Dataset(np.ones((2, 60), np.uint8), "1", "how each radius was computed", ("rayleigh", "mie", "goa")),
        "mean_extinction": Dataset((scattering + absorption) @ weight, "um^2", "averaged extinction cross section"),
        "mean_scattering": Dataset(scattering @ weight, "um^2", "averaged scattering cross section"),
        "mean_absorption": Dataset(absorption @ weight, "um^2", "averaged absorption cross section"),
        "mean_absorption_bias": Dataset(1e-4 * (absorption @ weight), "um^2", "estimated error of mean_absorption"),
        "error": Dataset(np.array([0.004, 0.003]), "1", "largest relative error of phase function and mean cross sections"),
        "phase": Dataset(phase, "1/sr", "phase function, averaged"),
        "phase_bias": Dataset(1e-3 * phase, "1/sr", "estimated error of phase"),
    })}, _stage("optics"))
    sigma_s, sigma_a = (1e8 * 1e-12 * (cross_section @ weight) for cross_section in (scattering, absorption))
    sigma_t_reduced, albedo_reduced, sigma_tr = reduced(sigma_s, sigma_a, g)
    medium = Group({
        "sigma_t": Dataset(sigma_s + sigma_a, "1/m", "extinction coefficient"),
        "sigma_s": Dataset(sigma_s, "1/m", "scattering coefficient"),
        "sigma_a": Dataset(sigma_a, "1/m", "absorption coefficient"),
        "albedo": Dataset(sigma_s / (sigma_s + sigma_a), "1", "single-scattering albedo"),
        "g": Dataset(g, "1", "mean cosine of the scattering angle"),
        "sigma_t_reduced": Dataset(sigma_t_reduced, "1/m", "reduced extinction coefficient"),
        "albedo_reduced": Dataset(albedo_reduced, "1", "reduced albedo"),
        "sigma_tr": Dataset(sigma_tr, "1/m", "decay of diffuse light"),
        "theta": Dataset(theta, "rad", "angle between the directions of travel"),
        "phase": Dataset(phase, "1/sr", "phase function"),
        "phase_bias": Dataset(1e-3 * phase, "1/sr", "estimated error of phase"),
        "cdf": Dataset(cumulative(theta, phase), "1", "cumulative distribution of theta"),
    }, _stage("medium"))
    return Group({
        "recipe": text("bakery: 1\nname: fog\n" + "# a comment as people write them\n" * 40, "the recipe's text"),
        "wavelength": Dataset(np.array([0.61, 0.465]), "um", "wavelengths in vacuum"),
        "optics": optics,
        "medium": medium,
        "provenance": Group({"optics": Group({"notes": text("none", "remarks of the stage")}, {"seconds": 1.5}),
                             "medium": Group({}, {"seconds": 0.1})},
                            {"created": "2026-01-01T00:00:00Z", "command": "bake fog.yaml"}),
    }, {"name": "fog", "bakery_version": "0.1.0"})


def _stage(name: str) -> dict:
    return {"stage": name, "stage_version": 1, "input_hash": "0" * 64, "tolerance": 0.01, "achieved_error": 0.004,
            "error_measure": "largest relative change of a coefficient"}


def with_member(root: Group, path: str, member: Dataset | Group | None) -> Group:
    """The tree with one member replaced, added or, given None, taken away.  Hashes stay as they are."""
    head, _, rest = path.partition("/")
    members = dict(root.members)
    inner = with_member(members[head], rest, member) if rest else member
    if inner is None:
        del members[head]
    else:
        members[head] = inner
    return Group(members, root.attributes)


def sealed_bytes(root: Group) -> bytes:
    """The file that `write` would make of a tree."""
    return bytes(image(seal(root)))


def resealed(data: bytes) -> bytes:
    """The same bytes with a digest in the first line that fits them: a corruption that only the content shows."""
    return bytes(user_block(data[USER_BLOCK:])) + data[USER_BLOCK:]
