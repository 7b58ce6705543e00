"""What the group `beam` can be asked: kernels of narrow beams, by name."""

from __future__ import annotations

import numpy as np

from bakery.physics.beam.kinds import MODELS
from bakery.stages.members import Members, MissingStage
from bakery.store.tree import Group


def view(root: Group) -> Beam:
    """The group as `bakery.open` gives it."""
    return Beam(root["beam"], root.groups.get("medium"))


class Beam(Members):
    """The group `beam`: kernels of a narrow beam, by name."""

    def __init__(self, group: Group, medium: Group | None):
        super().__init__(group, "beam")
        self._medium = medium

    def kernel(self, depth, r, measure: str = "fluence") -> np.ndarray:
        """How a narrow beam of unit power spreads, (L, ...) mfp^-2, scattered light only.

        Parameters
        ----------
        depth, r : mean free paths, 0 or more; broadcast
        measure : fluence (all directions), forward, flux (power through a surface across the beam): the best ones.  For
            comparison single, small_angle, small_angle_absorbing, erf, path_integral, and elek, which is approximate

        Raises
        ------
        ValueError : another measure, deeper than the tables, negative

        Notes
        -----
        0 at depth 0; infinite on the axis (but for path_integral and elek).
        """
        return np.stack([beam.kernel(depth, r, measure) for beam in self._ready()])

    def layered(self, thickness, density, r, measure: str = "forward") -> np.ndarray:
        """The kernel behind layers of unequal density, (L, *r.shape), per square of the unit of length.

        Parameters
        ----------
        thickness, density : (N,) of the layers, from where the beam enters to the plane; the unit of length is the mean free path
            at density 1
        r : > 0
        measure : forward, flux; for comparison single, small_angle and erf

        Raises
        ------
        ValueError : another measure, an optical depth beyond the tables, no layers
        """
        return np.stack([beam.layered(thickness, density, r, measure) for beam in self._ready()])

    def _ready(self) -> list:
        if "_kernels" not in self.__dict__:
            if self._medium is None:
                raise MissingStage("kernels of a beam need the group medium, which is missing; bake the recipe again")
            self._kernels = kernels_of(self._group, self._medium)
        return self._kernels


def tables_of(group: Group, name: str) -> list:
    """Tables of a `beam` group by the name of their dataset, one a wavelength, as `bakery.physics.beam.table.Table`."""
    from bakery.physics.beam.table import Table

    depth, ratio = (np.asarray(group[path].data, float) for path in ("depth", "ratio"))
    return [Table(depth, ratio, np.asarray(value, float)) for value in group[name].data]


def kernels_of(group: Group, medium: Group) -> list:
    """All kernels of a `beam` group by name, one set a wavelength, as `bakery.physics.beam.named.Kernels`."""
    from functools import cache

    from bakery.physics.beam.named import Kernels

    tables = cache(lambda name: tables_of(group, name))
    theta, phase = (np.asarray(medium[name].data, float) for name in ("theta", "phase"))
    transport = group["model"].data == MODELS.index("transport")
    return [Kernels(float(albedo), theta, phase[k], float(group["gaussian_b"].data[k]), bool(transport[k]),
                    lambda name, k=k: tables(name)[k]) for k, albedo in enumerate(medium["albedo"].data)]
