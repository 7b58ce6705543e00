"""What the group `surface` can be asked: reflectance, transmittance and albedo at any angles."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from bakery.errors import UsageError
from bakery.grammar.units import ANGLE, LENGTH
from bakery.stages.declaration import Answer, Query, Remark, lists_of
from bakery.stages.members import Members, MissingStage
from bakery.stages.surface import spread, under
from bakery.stages.surface.triangles import numbers, unpacked
from bakery.store.tree import Group

_TOLD = {"reflected": Remark("pi times the BRDF: 1 for a white Lambertian surface; without light that a smooth boundary mirrors"),
         "transmitted": Remark("pi times the BTDF; unscattered light is left out"),
         "albedo": Remark("share of the light that comes back, mirrored light included"),
         "spread": Remark("share of the light that comes out, from all sides to all sides, within the distance; without what a "
                          "boundary mirrors")}


def view(root: Group) -> Surface:
    """The group as `bakery.open` gives it."""
    return Surface(root["surface"], root.groups.get("medium"))


# of the light at a single pair, that interpolation between cells of counted light leaves (docs/measurements/surface.md)
BETWEEN_CELLS = 0.02


class Surface(Members):
    """The group `surface`: how a plane layer of the medium reflects.

    Angles are in rad from the normal, 0 to below pi/2; phi is the azimuth between the directions of travel, 0 for light that goes
    on forward.  Where there are several thicknesses, values have an axis for them behind that of the wavelengths.
    """

    def __init__(self, group: Group, medium: Group | None):
        super().__init__(group, "surface")
        self._medium = medium

    def reflectance(self, theta_in, theta_out, phi=0.0, layer: int | None = None) -> np.ndarray:
        """pi times the BRDF (L, ...), 1 for a white Lambertian surface; arguments broadcast.

        layer : position of the thickness; all of them if absent

        Light that a smooth boundary mirrors is left out, that of the facets of a rough one is not.
        """
        return self._looked_up("reflection", theta_in, theta_out, phi, layer)

    def transmittance(self, theta_in, theta_out, phi=0.0) -> np.ndarray:
        """pi times the BTDF (L, ...), 0 over a base; unscattered light left out."""
        return self._looked_up("transmission", theta_in, theta_out, phi)

    def by_order(self, theta_in, theta_out, phi=0.0, below: bool = False) -> np.ndarray:
        """The reflectance (3, L, ...) of light that one grain, two, and more have deflected; of grains only.

        below : the transmittance in its place

        Raises MissingStage : the layer is that of a medium, or lets no light through
        """
        if "first" not in counted_in(self._group).members:
            raise MissingStage("orders are kept apart where the reflectance is counted among grains (surface.method: grains)")
        if below and "transmitted" not in self:
            raise MissingStage("no light leaves below this layer; below one of a thickness without a base it does")
        at = np.broadcast_arrays(_cosine(theta_out), _cosine(theta_in), _azimuth(phi))
        flat = [np.ascontiguousarray(part, float).ravel() for part in at]
        values = np.array([[solution.orders(*flat, 1 if below else -1) for solution in row] for row in self._rows()])
        return np.moveaxis(self._layers(values), -2, 0).reshape(3, *values.shape[:1 + (values.shape[1] > 1)], *at[0].shape)

    def relative_error(self, theta_in, theta_out, phi=0.0, below: bool = False) -> np.ndarray:
        """Standard error (L, ...) of the reflectance over itself at pairs of directions; arguments broadcast.

        below : of the transmittance

        Of media it is the largest change of the last refinement, to 89.9 degrees, whatever the pair.  Of light that is counted
        among grains it is the noise of the pair's cells and what interpolation between them leaves.
        """
        mu, mu0, phi = np.broadcast_arrays(_cosine(theta_out), _cosine(theta_in), _azimuth(phi))
        from bakery.physics.surfaces import pairs

        counted = counted_in(self._group)
        if "noise" not in counted.members:
            values = np.asarray(self["change"], float)
            return self._layers(np.broadcast_to(values.reshape(*values.shape, *[1] * mu.ndim), (*values.shape, *mu.shape)))
        noise = np.asarray(counted["noise"].data, float)
        noise = noise[:, None] if counted is self._group else noise[:, :, min(int(below), noise.shape[2] - 1)]
        index, weight = pairs.interpolation(*(np.ravel(part) for part in (mu, mu0, math.pi - phi if below else phi)),
                                            noise.shape[2:])
        at = (noise.reshape(*noise.shape[:2], -1)[..., index] * weight).sum(axis=-1)
        return self._layers(np.hypot(at, BETWEEN_CELLS).reshape(*noise.shape[:2], *mu.shape))

    def albedo(self, theta) -> np.ndarray:
        """Share (L, ...) of light from an angle that comes back, mirrored light included."""
        cosine = _cosine(theta)
        values = albedo_at(self._group, cosine.ravel())
        return self._layers(values.reshape(*values.shape[:2], *cosine.shape))

    def spread_within(self, radius) -> np.ndarray:
        """Share (L, ...) of the light from all sides that comes out within distances (um) of where it went in.

        Of what comes out; what a boundary mirrors is left out.

        Raises MissingStage : the asset has no walks of light in the layer;  ValueError : a distance below 0, or no number
        """
        radius = np.asarray(radius, float)
        if not (radius >= 0).all():
            raise ValueError(f"radius {radius[~(radius >= 0)].flat[0]:g}; distances from 0 up, in um, would do")
        if "spread" not in self:
            raise MissingStage("light that is counted among grains has no spread, nor has an asset of a former version; "
                               "surface.method: medium has one of the medium that stands for grains")
        light = np.asarray(self["spread"], float).mean(axis=2).sum(axis=2)
        return self._layers(spread.within(self["spread_radius"], light, self["beyond"], radius))

    def table(self, layer: int = 0, from_below: bool = False):
        """What compiled loops and plugins look up, and its errors: `bakery.kernels.surface_reflectance` takes it.

        Parameters
        ----------
        layer : position of the thickness
        from_below : of light that comes from below, where a layer or layers on each other lie over air; of several they are
            solved upside down here, with as many moments as are stored

        Returns
        -------
        table : `bakery.physics.surfaces.table.SurfaceTable`
        errors : `bakery.physics.surfaces.table.Errors`

        Raises
        ------
        UsageError : no such layer, or nothing below it for light to come from
        """
        from bakery.physics.surfaces.table import surface_table

        solutions = self._of_layer(layer)
        if from_below and "transmitted" not in self:
            raise UsageError("surface: found a layer that no light enters from below; one of a thickness over air has two sides")
        if from_below and "under_index" in self:
            solutions = [self._turned(solution.slab, float(self["change"][k, layer])) for k, solution in enumerate(solutions)]
        return surface_table(solutions)

    def _turned(self, slab, tolerance: float):
        """The solution of layers on each other upside down."""
        from bakery.physics.surfaces.refine import moments_of
        from bakery.physics.surfaces.slab import upside_down
        from bakery.physics.surfaces.solution import solve

        slab, count = upside_down(slab), int(self["moments"][0])
        return solve(slab, moments_of(slab, count + 1), count, tolerance)

    @property
    def layers(self) -> int:
        """Number of thicknesses."""
        return self["reflected"].shape[1]

    def _of_layer(self, layer: int) -> list:
        """Of each wavelength, the solution of a layer."""
        if not 0 <= layer < self.layers:
            raise UsageError(f"surface: found no layer {layer}; it has {self.layers}: 0 to {self.layers - 1}")
        return [row[layer] for row in self._rows()]

    def _rows(self) -> list[list]:
        """Of each wavelength, the solution of each layer."""
        if "_solutions" not in self.__dict__:
            if self._medium is None:
                raise MissingStage("reflectance needs the group medium, which is missing; bake the recipe again")
            self._solutions = solutions_of(self._group, self._medium)
        return self._solutions

    def _looked_up(self, name: str, theta_in, theta_out, phi, layer: int | None = None) -> np.ndarray:
        at = _cosine(theta_out), _cosine(theta_in), _azimuth(phi)
        if layer is not None:
            return np.stack([getattr(solution, name)(*at) for solution in self._of_layer(layer)])
        return self._layers(np.stack([np.stack([getattr(solution, name)(*at) for solution in row]) for row in self._rows()]))

    def _layers(self, values):
        return values[:, 0] if values.shape[1] == 1 else values


def _cosine(theta) -> np.ndarray:
    theta = np.asarray(theta, float)
    outside = theta[~((theta >= 0) & (theta < math.pi / 2))]
    if outside.size:
        raise ValueError(f"angle {outside.flat[0]:g} from the normal; radians from 0 to below pi/2 would do")
    return np.cos(theta)


def _azimuth(phi) -> np.ndarray:
    phi = np.asarray(phi, float)
    if not np.isfinite(phi).all():
        raise ValueError(f"phi {phi[~np.isfinite(phi)].flat[0]:g}; finite radians would do")
    return phi


def _nodes(group: Group):
    """The solver's directions: a function of their number and of the index."""
    from bakery.physics.surfaces.nodes import nodes

    rough = group["roughness"].data[0] > 0
    return nodes(len(group["cosine"].data), 1.0 if rough else float(group["index"].data[0]))


def albedo_at(group: Group, cosine) -> np.ndarray:
    """Plane albedo (L, T, K) at cosines (K,) in air: a polynomial between the directions; 1 where light is totally reflected."""
    from bakery.physics.surfaces import fresnel, single
    from bakery.physics.surfaces.nodes import coordinate, interpolation

    directions = _nodes(group)
    index = directions.index
    albedo = np.asarray(group["albedo"].data, float)
    mirrored, at = fresnel.reflected(directions.air, index), fresnel.reflected(cosine, index)
    # what enters is a share of what is not mirrored
    entered = (albedo - mirrored) / (1 - mirrored)
    by, by_at = 1.0, 1.0
    if "depth" in group.members and index == 1 and not {"base", "under_index"} & group.members.keys():
        # a thin layer over air: the share that the layer meets rises steeply next to grazing, what it sends back of that does not
        depth = np.asarray(group["depth"].data, float)[..., None]
        by, by_at = single.interacts(directions.air, depth), single.interacts(cosine, depth)
    values = (entered / by) @ interpolation(directions.at, coordinate(cosine, index)).T * by_at
    return np.clip(at + (1 - at) * values, 0, 1)


def solutions_of(group: Group, medium: Group) -> list[list]:
    """Of each wavelength, the solution of each layer, as `bakery.physics.surfaces.solution.solve` gives it."""
    from bakery.physics.medium.similarity import without_delta
    from bakery.physics.surfaces.covered import Covered
    from bakery.physics.surfaces.cut import without_peak
    from bakery.physics.surfaces.slab import Slab
    from bakery.physics.surfaces.solution import Solution

    sigma_t, sigma_s, theta, phase = (np.asarray(medium[name].data, float) for name in ("sigma_t", "sigma_s", "theta", "phase"))
    if "forward_delta" in medium.members:
        sigma_t, sigma_s, phase = without_delta(sigma_t, sigma_s, theta, phase, np.asarray(medium["forward_delta"].data, float))
    directions, index, roughness = _nodes(group), float(group["index"].data[0]), float(group["roughness"].data[0])
    count, rows, widths = len(directions.air), [], group["thickness"].data if "thickness" in group.members else None
    above, below = (_orders(group, name) for name in ("reflected", "transmitted"))
    for k, layers in enumerate(above):
        albedo = float(sigma_s[k] / sigma_t[k]) if sigma_t[k] > 0 else 0.0
        base = float(group["base"].data[k]) if "base" in group.members else None
        stack = under.rebuilt(group, k)
        peak, row = float(group["peak"].data[k]), []
        for t, orders in enumerate(layers):
            depth = float(group["depth"].data[k, t]) if "depth" in group.members else math.inf
            slab = Slab(theta, phase[k], albedo, depth, index, base if stack is None else None, roughness, stack,
                        spread.length(sigma_t[k], math.inf if widths is None else widths[t]))
            reflected = unpacked(orders, count)
            cut, back = without_peak(albedo, peak), np.asarray(group["albedo"].data[k, t], float)
            if roughness > 0 and index != 1:
                row.append(Covered(slab, directions, (cut, *_cuts(slab, group, k)), reflected, back))
                continue
            if stack is not None:
                down = np.zeros_like(reflected[:1]) if below is None else below[k, t].reshape(-1, *reflected.shape[1:])
                row.append(_stacked(slab, directions, cut, (reflected, down), back, group, k, t))
                continue
            down = 0 * reflected if below is None else unpacked(below[k, t], count)
            passed = np.asarray(group["passed"].data[k, t], float)
            solution = Solution(slab, directions, cut, reflected, down, back, passed)
            row.append(_corrected(solution, group, k, t) if "first" in counted_in(group).members else solution)
        rows.append(row)
    return rows


def _orders(group: Group, name: str):
    """(L, T, M, P) Fourier orders of light; None where the group has none."""
    if name not in group.members:
        return None
    exponent = group.members.get(f"{name}_exponent")
    return np.asarray(group[name].data, float) if exponent is None else numbers(group[name].data, exponent.data)


def _stacked(slab, directions, cut, orders, albedo, group: Group, k: int, t: int):
    """A stack, at wavelength number k and thickness number t; orders : of reflected and of transmitted light."""
    from bakery.physics.surfaces.stack import Stacked

    cuts = (cut, *_cuts(slab, group, k))
    mirrored, passed = (np.asarray(group[name].data[k, t], float) for name in ("mirrored", "passed"))
    return Stacked(slab, directions, cuts, orders[0], albedo, mirrored, orders[1], passed)


def _cuts(slab, group: Group, k: int) -> list:
    """Of the layers under the uppermost one."""
    from bakery.physics.surfaces.cut import without_peak
    from bakery.physics.surfaces.slab import layers

    peaks = group["under_peak"].data[k] if "under_peak" in group.members else ()
    return [without_peak(part.albedo, float(peak)) for part, peak in zip(layers(slab)[0][1:], peaks, strict=True)]


def counted_in(group: Group) -> Group:
    """Where light counted among grains is: the group itself of half spaces, else `layers`, by thickness and side."""
    layers = group.members.get("layers")
    return layers if isinstance(layers, Group) else group


def _corrected(solution, group: Group, k: int, t: int):
    """What is counted among grains, at wavelength number k and thickness number t."""
    from bakery.physics.surfaces.corrected import ORDERS, Corrected, Factors

    counted = counted_in(group)
    at = [(k,)] if counted is group else [(k, t, side) for side in range(counted["scale"].data.shape[2])]
    sides = [Factors(tuple(np.asarray(counted[name].data[index], float) for name in ORDERS),
                     np.asarray(counted["scale"].data[index], float), float(counted["least"].data[0])) for index in at]
    straight = np.asarray(counted["straight"].data[k, t], float) if "straight" in counted.members else None
    return Corrected(solution, *sides, straight=straight)


# ---- queries


def looked_up(asset, path: str, arguments: Mapping[str, float | tuple[float, ...]]) -> Answer:
    """Reflectance, transmittance or albedo at angles, or light within a distance.

    Raises UsageError : an argument is missing, has no effect, or more than one is a list
    """
    name = path.rpartition("/")[2]
    accepted = {"albedo": ("theta_in",), "spread": ("radius",)}.get(name, ("theta_in", "theta_out", "phi"))
    example = " ".join(f"{key}={'1mm' if key == 'radius' else '30deg'}" for key in accepted)
    several = lists_of(path, arguments, accepted, accepted, accepted[:2], example)
    at = {key: np.asarray(value, float) for key, value in arguments.items()}
    surface = asset.surface
    try:
        function = {"albedo": surface.albedo, "spread": surface.spread_within, "reflected": surface.reflectance}
        asked = [at[key] for key in accepted if key in at]
        values = function.get(name, surface.transmittance)(*asked)
        directed = name in ("reflected", "transmitted")
        error = np.abs(values) * surface.relative_error(*asked, below=name == "transmitted") if directed else None
    except ValueError as fault:
        raise UsageError(f"{path}: {fault}") from None
    axes = (("wavelength", "um", asset.wavelength),)
    if len(surface["spherical_albedo"][0]) > 1:
        axes += (("thickness", "um", surface["thickness"]),)
    axes += tuple((key, "um" if key == "radius" else "rad", at[key]) for key in several)
    return Answer(path, "1", values, axes, error, (_TOLD[name],))


_ANGLES = {"theta_in": ANGLE, "theta_out": ANGLE, "phi": ANGLE}
QUERIES = (
    Query("surface/reflected", _ANGLES, "theta_in=30deg, theta_out=60deg, phi=0deg", looked_up),
    Query("surface/transmitted", _ANGLES, "theta_in=30deg, theta_out=60deg, phi=0deg", looked_up),
    Query("surface/albedo", {"theta_in": ANGLE}, "theta_in=30deg", looked_up),
    Query("surface/spread", {"radius": LENGTH}, "radius=1mm", looked_up),
)
