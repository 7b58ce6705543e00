"""What the group `optics` can be asked: the optical quantities of the asset in one table."""

from __future__ import annotations

from bakery.stages.members import Members, medium_theta
from bakery.stages.optics.quantities import table
from bakery.stages.optics.quantity_table import QuantityTable
from bakery.store.tree import Group


def view(root: Group) -> Optics:
    """The group as `bakery.open` gives it; its phase functions stand over the angles of the medium where it has none."""
    optics = Optics(root["optics"], "optics", medium_theta(root), root["wavelength"].data)
    optics._root = root
    return optics


class Optics(Members):
    """The group `optics`: cross sections and phase functions of each component."""

    def table(self, length=None, density=None, wavelength=None) -> QuantityTable:
        """Extinction to lidar ratio, effective radius and visibility: `bake query ASSET optics`.

        Parameters
        ----------
        length : m, or text with its unit, "100 m": the path of which optical depth and transmittance are wanted
        density : kg/m^3, or text with its unit, "1.8 g/cm^3", of components of which the recipe states none
        wavelength : um, one or several, or text: instead of the baked ones, also between them

        Examples
        --------
        >>> asset.optics.table(length="100 m")["lidar_ratio"].values                                # doctest: +SKIP
        """
        return table(self._root, length, density, wavelength)
