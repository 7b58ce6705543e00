"""A discrete medium as its kernels see it: discs, and how each class of particles scatters, forward peak taken out or not."""

import math
from typing import NamedTuple

import numpy as np

from bakery import kernels
from renderers.materials.particles.shadow import Overlap, overlap_of

_METRES, _SQUARE_METRES = 1e-6, 1e-12  # um, um^2
_HALF = 0.5  # of a pixel, within which a peak counts as unscattered


class Scatterer(NamedTuple):
    """What kernels of scatterings read of a `Medium`: taking each array of a record apart takes 10 ms of compiling a kernel.

    albedo, phase, cdf : rows of all wavelengths of a class after those of the class before, as `scattering.mean_phase` has them
    """

    albedo: np.ndarray
    v: np.ndarray
    steps: np.ndarray
    phase: np.ndarray
    cdf: np.ndarray
    to_rgb: np.ndarray
    to_waves: np.ndarray


class Medium(NamedTuple):
    """K classes of particles, from large to small, and as class K the continuous medium that they make on average.

    discs : `bakery.kernels.Discs`
    density : (K,) 1/m^3, where the region is full
    sigma_t : (L,) 1/m, extinction where the region is full
    albedo : (K + 1, L)
    v, steps : (A,), (A - 1,), as `bakery.kernels.phase_layout` has them
    phase : (K + 1, L, A) 1/sr;  cdf : the same, cumulated
    host : (L,) 1/m, absorption in the region's box besides that of particles
    to_rgb : (3, L) linear sRGB from radiances;  to_waves : (L, 3) radiances from linear sRGB
    overlap : `renderers.materials.particles.shadow.Overlap`
    others : share of the continuous medium that light meets which a particle has scattered: without that particle
    """

    discs: object
    density: np.ndarray
    sigma_t: np.ndarray
    albedo: np.ndarray
    v: np.ndarray
    steps: np.ndarray
    phase: np.ndarray
    cdf: np.ndarray
    host: np.ndarray
    to_rgb: np.ndarray
    to_waves: np.ndarray
    overlap: Overlap
    others: float = 1.0

    @property
    def scatterer(self) -> Scatterer:
        """Without where particles are."""
        tables = (table.reshape(-1, len(self.v)) for table in (self.phase, self.cdf))
        return Scatterer(self.albedo.ravel(), self.v, self.steps, *tables, self.to_rgb, self.to_waves)


class Classes(NamedTuple):
    """What the particles are: classes of all components one after the other.

    density : (K,) 1/m^3, where the region is full
    extinction, scattering : (L, K) m^2
    theta : (A,) rad;  phase : (L, K, A) 1/sr
    radius : (K,) m
    component : (K,) number of the component of each
    peak : (L,) share of the extinction of all that the forward peak was, which was taken out
    host : (L,) 1/m, absorption of what is between the particles
    """

    density: np.ndarray
    extinction: np.ndarray
    scattering: np.ndarray
    theta: np.ndarray
    phase: np.ndarray
    radius: np.ndarray
    component: np.ndarray
    peak: np.ndarray
    host: np.ndarray

    @property
    def sigma_t(self):
        """(L,) 1/m, extinction coefficient of all."""
        return self.extinction @ self.density


def classes_of(group) -> Classes:
    """The classes of `asset.discrete`, as they were baked."""
    baked = group.classes()
    return Classes(float(group.number_density[0]) * baked.share, baked.extinction * _SQUARE_METRES,
                   baked.scattering * _SQUARE_METRES, np.asarray(baked.theta, float), np.asarray(baked.phase, float),
                   baked.radius * _METRES, baked.component, np.zeros(len(baked.extinction)),
                   np.asarray(group.host_absorption, float))


def in_bands(classes, bands) -> Classes:
    """The classes in C bands instead of L wavelengths: cross sections are means, phase functions means by scattering.

    bands : (C, L), rows add up to 1
    """
    scattering = bands @ classes.scattering
    phase = np.einsum("cl,lk,lka->cka", bands, classes.scattering, classes.phase) / np.maximum(scattering, 1e-300)[..., None]
    phase[scattering <= 0] = 1 / (4 * math.pi)
    return classes._replace(extinction=bands @ classes.extinction, scattering=scattering, phase=phase, peak=np.zeros(len(bands)),
                            host=bands @ classes.host)


def peak_of(peak, world) -> float:
    """The key `peak` of an entry, rad: `auto` is half a pixel, `keep` nothing."""
    if peak == "keep":
        return 0.0
    return _HALF * float(np.median(world.camera.angle(*world.size))) if peak == "auto" else peak


def without_peak(classes, angle) -> Classes:
    """The classes without what their phase functions have above their value at `angle` (rad), within it.

    That light counts as unscattered: extinction and scattering lose the same.
    """
    theta = classes.theta
    inside = theta < angle
    if not inside.any():
        return classes
    at = kernels.phase_at(theta, classes.phase, np.array([angle]))  # (L, K, 1)
    cut = np.where(inside, np.minimum(classes.phase, at), classes.phase)
    kept = kernels.phase_integral(theta, cut)
    lost = classes.scattering * (1 - kept)
    extinction = classes.extinction - lost
    return classes._replace(extinction=extinction, scattering=classes.scattering - lost, phase=cut / kept[..., None],
                            peak=(lost @ classes.density) / np.maximum(classes.sigma_t, 1e-300))


def medium(classes, discs_of, to_rgb, to_waves) -> tuple[Medium, np.ndarray]:
    """The layout for the kernels, and (K,) which of `classes` each of the medium's is.

    classes : `Classes`
    discs_of : function of (extinction (L, K), density (K,), order (K,)) with the classes from large to small -> `Discs`
    to_rgb, to_waves : see `Medium`
    """
    order = kernels.disc_order(classes.extinction)
    extinction, scattering = classes.extinction[:, order], classes.scattering[:, order]
    density, phase = classes.density[order], classes.phase[:, order]
    sigma_t, sigma_s = extinction @ density, scattering @ density
    share = scattering * density / np.maximum(sigma_s, 1e-300)[:, None]
    mean = np.einsum("lk,lka->la", share, phase)
    mean[sigma_s <= 0] = 1 / (4 * math.pi)
    tables = np.concatenate([np.moveaxis(phase, 1, 0), mean[None]])
    layouts = [[kernels.phase_layout(classes.theta, row) for row in rows] for rows in tables]
    v, steps = (layouts[0][0][i] for i in range(2))
    albedo = np.concatenate([(scattering / np.maximum(extinction, 1e-300)).T, (sigma_s / np.maximum(sigma_t, 1e-300))[None]])
    return Medium(discs_of(extinction, density, order), density, sigma_t, np.clip(albedo, 0.0, 1.0), v, steps,
                  *(np.array([[layout[k] for layout in row] for row in layouts]) for k in (2, 3)),
                  *(np.array(table, float, order="C") for table in (classes.host, to_rgb, to_waves)),
                  overlap_of(density, extinction, scattering)), order
