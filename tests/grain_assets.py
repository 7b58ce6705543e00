"""Assets of packed grains for tests of pictures, exports and renderers: measured here, written through the store.

The layout is that of the stage `grains`; mixing follows Meng et al. 2015, equations 1 to 4, for grains of equal radius.
"""

import json

import numpy as np

from bakery.physics.grains.bvh import Mesh
from bakery.physics.grains.scatterometer import measure
from bakery.physics.grains.sphere import ball
from bakery.physics.grains.surface import conductor, dielectric, diffuse
from bakery.physics.medium.phase import areas, cumulative, mean_cosine, normalised, phase_at
from bakery.physics.medium.similarity import reduced
from bakery.physics.shapes.build import build
from bakery.store.tree import Dataset, Group, text

RGB = (0.61, 0.55, 0.465)
RADIUS = 0.5e-3  # m
FIGURES = {"albedo": "share of the light that hits which leaves", "lambda_s": "mean way along the incoming direction",
           "lambda_o": "mean way along the outgoing direction", "mean_square": "mean squared way", "g": "mean cosine",
           "forward_delta": "share that leaves unchanged", "inner_path": "mean length of the way inside"}


PEAK = 1e-3  # rad: what leaves unchanged stands below it in the medium's table


def nodes(count: int = 181) -> np.ndarray:
    """Angles that were measured at."""
    return np.linspace(0.0, np.pi, count)


def angles() -> np.ndarray:
    """Those of the table: one more, for the peak."""
    return np.insert(nodes(), 1, PEAK)


def edges_of(theta) -> np.ndarray:
    """(A + 1,) cells around the nodes, cut at the mean cosine of neighbours."""
    cosine = np.cos(theta)
    return np.concatenate([[0.0], np.arccos((cosine[1:] + cosine[:-1]) / 2), [np.pi]])


def component(shape, surface, *, interior=(0.0,) * 3, weight=1.0, triangles=1300, tolerance=0.02,
              by_radius=False) -> Group:
    """One measured component; `surface` is the text that is stored, as a dict.  Relative indices, interior in 1/m."""
    theta = nodes()
    mesh = build(shape, triangles)
    count = len(interior)
    mu = np.asarray(interior) * RADIUS
    found = []
    for k in range(count):
        if mesh.analytic == "sphere":
            one = ball(_surface(surface, k), mu[k], edges_of(theta))
        else:
            one = measure(Mesh(mesh.vertices, mesh.faces), _surface(surface, k), mu[k], seed=1, tolerance=tolerance,
                          asked=("albedo", "g"), edges=edges_of(theta))
        found.append(one)
    members = {
        "vertices": Dataset(mesh.vertices, "1", "corners of the triangles"),
        "faces": Dataset(mesh.faces, "1", "triangles"),
        "weight": Dataset(np.array([weight]), "1", "share of the number of grains"),
        "surface": text(json.dumps(surface), "surface, JSON"),
        "shape": text(json.dumps(shape), "shape, JSON"),
        "interior": Dataset(np.asarray(interior, float), "1/m", "absorption coefficient of the interior"),
        "events": Dataset(np.array([getattr(found[0], "events", 0.0)]), "1", "meetings with the surface"),
        "paths": Dataset(np.array([getattr(found[0], "paths", 0)]), "1", "paths"),
        "hits": Dataset(np.array([getattr(found[0], "hits", 0)]), "1", "paths that hit"),
        "contradicted": Dataset(np.array([getattr(found[0], "contradicted", 0.0)]), "1", "share of contradicted paths"),
        "lost": Dataset(np.array([max(float(np.max(getattr(one, "lost", 0.0))) for one in found)]), "1", "share of light cut"),
    }
    for name in ("hit_probability", "lambda_delta", "chord"):
        members |= _with_error(name, [getattr(found[0], name)], [found[0].errors.get(name, 0.0)], "1", name)
    for name, said in FIGURES.items():
        members |= _with_error(name, [float(getattr(one, name)[0]) for one in found],
                               [float(np.ravel(one.errors.get(name, [0.0]))[0]) for one in found], "1", said)
    phase, error = (phase_at(theta, np.stack([np.broadcast_to(values(one), (1, len(theta)))[0] for one in found]), angles())
                    for values in (lambda one: one.phase, lambda one: one.errors["phase"]))
    members |= _with_error("phase", normalised(angles(), phase)[0], error, "1/sr", "phase function of what leaves changed")
    members["lossless"] = Group({name + end: members[name + end] for name in ("lambda_s", "mean_square", "g", "forward_delta")
                                 for end in ("", "_error")})  # not measured: what is drawn here does not ask for it
    if by_radius:
        members["by_radius"] = Group({name: Dataset(np.stack([members[name].data * factor for factor in (1.0, 0.97, 0.9)]),
                                                    members[name].units, name)
                                      for name in ("albedo", "lambda_s", "mean_square", "g", "forward_delta", "phase")})
    return Group(members)


def _with_error(name, values, errors, units, said) -> dict:
    return {name: Dataset(np.asarray(values, float), units, said),
            f"{name}_error": Dataset(np.asarray(errors, float), units, f"standard error of {name}")}


def _surface(stored, k):
    if stored["type"] == "dielectric":
        return dielectric(stored["index"][k], stored["roughness"])
    if stored["type"] == "diffuse":
        return diffuse(stored["reflectance"][k])
    return conductor(stored["n"][k] + 1j * stored["k"][k], stored["roughness"])


def asset(components: dict[str, Group], *, fraction=0.6, wavelength=RGB, radii=(1.0,), name="sand") -> Group:
    """The asset's tree: grains and the medium that stands for them."""
    theta = angles()
    radii = np.asarray(radii)
    grains = Group({"theta": Dataset(theta, "rad", "angle between the directions of travel"),
                    "radius": Dataset(RADIUS * radii, "m", "radii of the bounding spheres"),
                    "radius_share": Dataset(np.full(radii.size, 1 / radii.size), "1", "share of the number")} | components,
                   _stage("grains"))
    return Group({"recipe": text("bakery: 1\nname: sand\n", "recipe"),
                  "wavelength": Dataset(np.asarray(wavelength, float), "um", "wavelengths"), "grains": grains,
                  "medium": _medium(list(components.values()), theta, fraction)}, {"name": name, "bakery_version": "0.1.0"})


def _medium(parts, theta, fraction) -> Group:
    weight = np.array([part["weight"].data[0] for part in parts])
    hit = np.array([part["hit_probability"].data[0] for part in parts])

    def of(name):
        return np.stack([part[name].data for part in parts])

    def mean(share, name):
        return np.sum(share / share.sum(0) * of(name), axis=0)

    beta = weight @ hit
    missed = weight * (1 - hit)
    lambda_delta = 0.0 if missed.sum() == 0 else missed @ of("lambda_delta")[:, 0] / missed.sum()
    struck = (weight * hit)[:, None]
    albedo = mean(struck, "albedo")
    lit = struck * of("albedo")
    lambda_s, mean_square, g, forward = (mean(lit, name) for name in ("lambda_s", "mean_square", "g", "forward_delta"))
    changed = lit * (1 - of("forward_delta"))
    table = np.sum(changed[:, :, None] / np.maximum(changed.sum(0), 1e-12)[:, None] * of("phase"), axis=0)
    error = np.sqrt(np.sum((changed[:, :, None] / np.maximum(changed.sum(0), 1e-12)[:, None] * of("phase_error")) ** 2, axis=0))
    phase = (1 - forward[:, None]) * table
    phase[:, 0] += forward / (2 * np.pi * areas(theta)[0])
    phase, _ = normalised(theta, phase)
    void = 4 / 3 * (1 - fraction) / fraction
    lambda_beta = void + (void + lambda_delta) * (1 - beta) / beta
    lambda_t = (lambda_beta + albedo * lambda_s) * RADIUS
    sigma_t = 1 / lambda_t
    m_rte = 2 * lambda_t**2 / (1 - g)
    second = np.sqrt(2 / ((1 - g) * (m_rte + mean_square * RADIUS**2)))
    walked = second / 1.03
    cosine = mean_cosine(theta, phase)
    sigma_s = albedo * sigma_t
    improved = reduced(sigma_s, sigma_t - sigma_s, cosine)
    values = {"sigma_t": sigma_t, "sigma_s": sigma_s, "sigma_a": sigma_t - sigma_s, "albedo": albedo, "g": cosine,
              "sigma_t_reduced": improved[0], "albedo_reduced": improved[1], "sigma_tr": improved[2], "theta": theta,
              "phase": phase, "phase_error": error, "cdf": cumulative(theta, phase), "forward_delta": forward,
              "lambda_beta": np.array([lambda_beta * RADIUS]), "mean_square": mean_square * RADIUS**2,
              "sigma_t_mean_flight": sigma_t, "sigma_t_second_moment": second, "sigma_t_random_walk": walked,
              "fraction": np.array([fraction])}
    shares = {"sigma_t_mean_flight": 2e-3, "sigma_t_second_moment": 3e-3, "sigma_t_random_walk": 0.02, "albedo": 1e-3}
    values |= {f"{name}_error": share * values[name] for name, share in shares.items()}
    return Group({key: Dataset(np.asarray(value, float), _units(key), key.replace("_", " ")) for key, value in values.items()},
                 _stage("medium"))


def _units(name: str) -> str:
    special = {"theta": "rad", "phase": "1/sr", "phase_error": "1/sr", "lambda_beta": "m", "mean_square": "m^2"}
    return special.get(name, "1/m" if name.startswith("sigma") else "1")


def _stage(name: str) -> dict:
    return {"stage": name, "stage_version": 1, "input_hash": "0" * 64, "tolerance": 0.01, "achieved_error": 0.004,
            "error_measure": "largest relative standard error"}
