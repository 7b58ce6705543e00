"""What formats add where an asset holds a baked surface: files of its layers, and what those lose."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bakery.export.declaration import Job, Written
from bakery.store.outputs import FileKind

TENSOR = FileKind("BRDF tensor file", lambda head: head.startswith(b"tensor_file\0"))
MIRRORED = "light that the smooth boundary mirrors ({:.3g} % at normal incidence, {:.3g} % of light from all sides)"


class Layer(NamedTuple):
    """One thickness of an asset's surface."""

    number: int  # its position
    name: str  # of the material and, with an ending, of its files
    # index, roughness: of its boundary
    index: float
    roughness: float
    free: bool  # whether light passes it

    @property
    def mirrors(self) -> bool:
        """Whether a smooth boundary mirrors light."""
        return self.index != 1 and self.roughness == 0

    def mirrored(self) -> tuple[float, float]:
        """Percent of the light from the normal, and of that from all sides, that a smooth boundary mirrors."""
        from bakery.physics.surfaces import fresnel
        from bakery.physics.surfaces.nodes import nodes

        directions = nodes(64)
        return 100 * float(fresnel.reflected(1.0, self.index)), \
            100 * float(directions.flux @ fresnel.reflected(directions.mu, self.index))


class Addition(NamedTuple):
    """Files of one layer."""

    files: Mapping[str, str | bytes]  # name -> content
    loss: Mapping[str, Any]  # for machines
    lines: Sequence[str]  # for people


def layers(job: Job) -> Iterator[Layer]:
    """The layers of the asset's surface; none where it has no stage `surface`."""
    if "surface" not in job.asset.tree.members:
        return
    surface = job.asset.surface
    for number in range(surface.layers):
        name = f"{job.stem}_surface" + (f"_{number}" if surface.layers > 1 else "")
        yield Layer(number, name, float(surface["index"][0]), float(surface["roughness"][0]), "transmitted" in surface)


def reflectance(job: Job, layer: Layer):
    """Function of theta_in, theta_out, phi (Q,) to (L, Q)."""
    return lambda *at: job.asset.surface.reflectance(*at, layer=layer.number)


def with_surfaces(job: Job, written: Written, add) -> Written:
    """What was written of the medium, and what `add` (of job and layer) gives of the layers."""
    additions = [add(job, layer) for layer in layers(job)]
    files, lines, losses = dict(written.files), list(written.lines), list(written.losses)
    for addition in additions:
        files |= addition.files
        lines += [f"{', '.join(addition.files)}:", *(f"  {line}" for line in addition.lines)]
        losses.append({"surface": list(addition.files)} | dict(addition.loss))
    return written._replace(files=files, lines=lines, losses=losses)


def table_of(job: Job, layer: Layer):
    """`bakery.physics.surfaces.measured.Measured` of a layer, its loss for machines and in words."""
    from bakery.physics.surfaces.measured import measured

    table = measured(reflectance(job, layer), job.asset.wavelength)
    count, incident = table.values.shape[3], len(table.theta_in)
    lines = [f"measured BRDF: {incident} angles of incidence, {count} x {count} half vectors; of light from all sides "
             f"{100 * table.losses.misdirected:.2g} % goes to another direction, and the albedo is off by up to "
             f"{100 * table.losses.albedo:.2g} % at 0 to 80 deg"]
    if layer.free:
        lines.append("light that passes the layer is left out: it is opaque here")
    return table, {"misdirected": table.losses.misdirected, "albedo": table.losses.albedo}, lines


def profile_of(job: Job, layer: Layer):
    """Widths d (3,) m of Burley and Christensen's profile in red, green and blue, and its largest misfit; None: none is baked.

    Each is the nearest to the light of its band, which spreads by no single profile where its wavelengths spread differently.
    """
    from bakery.physics.surfaces.spread import profile

    surface = job.asset.surface
    if "profile" not in surface:
        return None
    light = np.asarray(surface["spread"][:, layer.number], float).mean(axis=1).sum(axis=1)
    radius, beyond = surface["spread_radius"][:, layer.number], surface["beyond"][:, layer.number]
    profiles = []
    for shares in job.colour.band_matrix(job.asset.wavelength):
        rows = np.flatnonzero(shares)
        ends = np.unique(np.append(0.0, radius[rows]))
        within = sum(shares[row] * np.interp(ends, np.append(0.0, radius[row]), np.append(0.0, light[row].cumsum()))
                     for row in rows)
        profiles.append(profile(ends, np.diff(within), float(shares @ beyond)))
    widths, misfits = np.transpose(profiles)
    return 1e-6 * widths, float(misfits.max())


def sampled(job: Job, layer: Layer):
    """`bakery.physics.surfaces.principled.Sampled` of a layer."""
    from bakery.physics.surfaces.principled import Sampled

    return Sampled(reflectance(job, layer), layer.index, layer.roughness, job.colour.band_matrix(job.asset.wavelength))


def fit_of(samples, layer: Layer):
    """`bakery.physics.surfaces.principled.Principled` of a layer that is sampled, its loss for machines and in words."""
    from bakery.physics.surfaces.principled import fitted

    fit = fitted(samples)
    lines = [f"rough diffuse base of roughness {fit.diffuse_roughness:.2g}"
             + ("" if layer.index == 1 else f" under a boundary of index {layer.index:g}, alpha {layer.roughness:g}")
             + f": {errors_told(fit)}"]
    if fit.clipped > 1e-6:
        lines.append(f"a base of colour 1 lacks {100 * fit.clipped:.2g} % of the light from all sides")
    if layer.free:
        lines.append("light that passes the layer is left out: it is opaque here")
    return fit, {**errors_of(fit), "clipped": fit.clipped, "diffuse_roughness": fit.diffuse_roughness}, lines


def errors_of(fit) -> dict:
    """Of a `Principled` or a `ByView`, for machines."""
    return {name: getattr(fit, name).tolist() for name in ("misdirected", "brightness_error", "albedo_error")}


def errors_told(fit) -> str:
    """The same for people, of the worst colour."""
    from bakery.physics.surfaces.principled import ANGLES

    def at_angles(errors):
        worst = np.abs(errors).argmax(axis=0)
        return ", ".join(f"{100 * errors[band, k]:+.2g} % at {angle:g} deg"
                         for k, (angle, band) in enumerate(zip(ANGLES, worst, strict=True)))

    return (f"{100 * fit.misdirected.max():.2g} % of the light that comes out of the layer goes to another direction; brightness "
            f"in light from all sides is off by {at_angles(fit.brightness_error)}, what is reflected of light from one angle by "
            f"{at_angles(fit.albedo_error)}")
