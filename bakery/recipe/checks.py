"""What has to hold between the keys of a recipe.

The checks see the tree and the values that were well formed (dotted key -> value), so they say what they can even where other
keys are wrong.  A key that is missing or malformed is passed over here: the schema has reported it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from bakery.errors import Problem
from bakery.grammar import tables
from bakery.grammar.fields import nearest
from bakery.grammar.files import DataFile, Folder, materials
from bakery.grammar.section import SMALLEST_N, given, meant
from bakery.grammar.text import Mapping, Node, Sequence, owner, show
from bakery.grammar.units import Wrong
from bakery.physics.materials import Table
from bakery.physics.materials import index as constants
from bakery.recipe import grain_checks, wavelengths
from bakery.recipe.model import Index
from bakery.recipe.schema import NAMED_WAVELENGTHS, NOT_YET, SOURCES

SMALLEST, LARGEST = 1e-8, 1e6  # size parameters that Lorenz-Mie sums cover
STEEPEST = 1 - 1e-9  # largest |g| of a Henyey-Greenstein function: its lobe is narrower than that of any particle above
CLEAR = 1e-3  # largest k of a host: above it, cross sections of a sphere in it are not defined by Lorenz-Mie theory
_SHARES = 1e-6


@dataclass
class Checker:
    """Runs the checks; then `problems`, `warnings`, `files` and, by key, `indices`, `columns`, `meshes` hold what was found."""

    tree: Mapping
    values: dict
    folder: Folder
    problems: list[Problem] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)
    files: list[DataFile] = field(default_factory=list)
    indices: dict[str, Index] = field(default_factory=dict)
    columns: dict[str, np.ndarray] = field(default_factory=dict)
    meshes: dict[str, tuple[bytes, str]] = field(default_factory=dict)
    wavelength: tuple[float, ...] | None = None

    def run(self) -> None:
        self._wavelengths()
        self._source()
        for section in _mappings(self.tree.get("particles")):
            self._particles(section)
        for section in _mappings(self.tree.get("medium")):
            self._medium(section)
        for section in _mappings(self.tree.get("phase")):
            if self.value(section, "switch") not in ("auto", None) and self.value(section, "method") != "goa":
                self.report(section["switch"], "found a size parameter for the switch to rays with another method than goa",
                             "expected method: goa beside it, or switch: auto")
        for section in _mappings(self.tree.get("grains")):
            grain_checks.check(self, section)
        for section in _mappings(self.tree.get("packing")):
            self._packing(section)
        self._unusual_wavelengths()
        for name in NOT_YET:
            if name in self.tree:
                self.report_section(self.tree[name], f"{name} is not available yet", "particles, grains and medium are")

    # ---- tools

    def report(self, node: Node, found: str, expected: str, offset: int = 0) -> None:
        self.problems.append(node.place.problem(found, expected, offset))

    def report_section(self, node: Node, found: str, expected: str) -> None:
        self.problems.append(owner(node).problem(found, expected))

    def value(self, section: Mapping, name: str):
        node = section.get(name)
        return None if node is None else self.values.get(node.place.key)

    def several(self, node: Node | None) -> tuple | None:
        """The values of a key that takes one value or several; None unless all are well formed."""
        if isinstance(node, Sequence):
            found = tuple(self.values.get(item.place.key) for item in node)
            return found if found and None not in found else None
        return None if node is None else self.values.get(node.place.key)

    def one_each(self, section: Mapping, name: str) -> np.ndarray | None:
        """A key with one value for all wavelengths or one for each, (L,)."""
        values = self.several(section.get(name))
        if values is None or self.wavelength is None:
            return None
        count = len(self.wavelength)
        if len(values) not in (1, count):
            self.report(
                section[name],
                f"found {len(values)} values for {count} wavelength{'s' * (count != 1)}",
                "expected one value, or one a wavelength",
            )
            return None
        found = np.array(values * count if len(values) == 1 else values, dtype=float)
        self.columns[section[name].place.key] = found
        return found

    # ---- the sections

    def _wavelengths(self) -> None:
        node = self.tree.get("wavelengths")
        self.wavelength = NAMED_WAVELENGTHS["rgb"] if node is None else self.several(node)
        if self.wavelength is None:
            return
        if len(self.wavelength) > 4096:
            self.report(node, f"found {len(self.wavelength):,} wavelengths", "expected at most 4,096")
            self.wavelength = None
        elif len(set(self.wavelength)) < len(self.wavelength):
            double = next(w for i, w in enumerate(self.wavelength) if w in self.wavelength[:i])
            self.report(node, f"found {double:g} um more than once", "expected distinct wavelengths")

    def _unusual_wavelengths(self) -> None:
        """A warning for wavelengths far from what is seen; a table of the user's own that has them says that they are meant."""
        far = wavelengths.far(self.wavelength or ())
        if not far or any(file.key.endswith(("material.file", "host.file")) for file in self.files):
            return
        near = wavelengths.likely(far)
        low, high = wavelengths.TABLES
        self.warnings.append(self.tree["wavelengths"].place.problem(
            f"found {wavelengths.listed(far)} um, far from what is seen (0.4 to 0.8 um) and from the tables of materials "
            f"({low:g} to {high:g} um)", f"give the unit that is meant ({near}?)" if near else "is the unit right?"))

    def host(self, section: Mapping, default: str) -> Index | None:
        """Optical constants of what particles or grains lie in."""
        host = self.index(section, "host", default)
        if host is not None and host.k.max() > CLEAR:
            self.report(
                section.get("host", section),
                f"found a host that absorbs (k = {host.k.max():.3g})",
                f"expected a clear host, k at most {CLEAR:g}",
            )
        return host

    def _source(self) -> None:
        present = [name for name in SOURCES if name in self.tree]
        if not present and "packing" not in self.tree:
            self.problems.append(
                self.tree.place.problem(
                    "found nothing that scatters", "expected exactly one of particles, grains, medium", key=""
                )
            )
        for name in present[1:]:
            self.report_section(
                self.tree[name], f"found {name} beside {present[0]}", "expected exactly one of particles, grains, medium"
            )
        if "phase" in self.tree and present and "particles" not in present:
            self.report_section(
                self.tree["phase"],
                f"found options of single scattering beside {present[0]}",
                "expected them with particles only" + (" (medium.phase?)" if "medium" in present else ""),
            )

        for name in ("scatterometer", "effective_medium"):
            if name in self.tree and "grains" not in self.tree:
                self.report_section(self.tree[name], f"found {name} without grains", "expected it with grains only")
        for name in ("multiple_scattering", "beam"):
            if name in self.tree and not present:
                self.report_section(self.tree[name], f"found {name} without anything that scatters",
                                    "expected particles, grains or medium beside it")
        multiple = self.tree.get("multiple_scattering")
        sources = self.several(multiple.get("sources")) if isinstance(multiple, Mapping) else None
        if sources and len(set(sources)) < len(sources):
            self.report(multiple["sources"], "found a source twice", "expected point and segment once each")
        if isinstance(multiple, Mapping) and self.value(multiple, "method") == "solver" \
                and self.value(multiple, "photons") not in ("auto", None):
            self.report(multiple["photons"], "found a number of photons beside method: solver",
                        "expected method: photons or auto")

    def _particles(self, section: Mapping) -> None:
        amounts = given(section, "number_density", "volume_fraction")
        if not amounts:
            self.report_section(section, "found neither number_density nor volume_fraction", "expected one of them")
        elif len(amounts) == 2:
            second = section.get(amounts[1], section)
            self.report_section(second, f"found {amounts[1]} beside {amounts[0]}", "expected only one of them")
        host = self.host(section, "air")
        for part in self.components(section, "fraction"):
            self.index(part, "material")
            for size in _mappings(part.get("size")):
                self._size(size, host)

    def components(self, section: Mapping, share: str) -> list[Mapping]:
        """The mappings in a list of components, whose names and shares are checked."""
        node = section.get("components")
        parts = list(_mappings(*node)) if isinstance(node, Sequence) else []
        seen: dict[str, str] = {}
        for part in parts:
            name = self.value(part, "name")
            # two names that differ in case alone are one file on some systems
            if name is not None and name.lower() in seen:
                self.report(
                    part["name"], f"found {show(name)} a second time (first in {seen[name.lower()]})", "expected distinct names"
                )
            elif name is not None:
                seen[name.lower()] = str(part["name"].place)
        if parts and len(parts) == len(node):
            self._shares(node, share, parts, 1.0)
        return parts

    def _shares(self, node: Sequence, name: str, parts: list[Mapping], default: float | None) -> None:
        if any(name in meant(part) for part in parts):
            return
        shares = [self.value(part, name) if name in part else default for part in parts]
        if None not in shares and abs(math.fsum(shares) - 1) > _SHARES:
            self.report_section(node, f"found {name}s that add up to {math.fsum(shares):.7g}", "expected 1")

    def _size(self, size: Mapping, host: Index | None, low: float | None = None, high: float | None = None) -> None:
        """One distribution; `low` and `high` are the cuts of the mixture that it is part of."""
        smallest, largest, radius = (self.value(size, name) for name in ("min", "max", "radius"))
        if smallest is not None and largest is not None and smallest >= largest:
            self.report(size["max"], f"found max {largest:g} um, not above min {smallest:g} um", "expected min below max")
            return
        for name in ("radius", "min", "max"):
            if self.value(size, name) is not None:
                self._size_parameter(size[name], f"{name} of {self.value(size, name):g} um", self.value(size, name), host)
        distribution = self.value(size, "distribution")
        inner_low = max((v for v in (low, smallest) if v is not None), default=None)
        inner_high = min((v for v in (high, largest) if v is not None), default=None)
        if distribution == "mixture":
            of = size.get("of")
            parts = list(_mappings(*of)) if isinstance(of, Sequence) else []
            for part in parts:
                self._size(part, host, inner_low, inner_high)
            if parts and len(parts) == len(of):
                self._shares(of, "share", parts, None)
            return
        if distribution == "table":
            self._size_table(size, host, inner_low, inner_high)
        elif radius is not None and (
            inner_low is not None and radius < inner_low or inner_high is not None and radius > inner_high
        ):
            bounds = " to ".join("…" if v is None else f"{v:g}" for v in (inner_low, inner_high))
            self.report(
                size["radius"],
                f"found a radius of {radius:g} um outside of min and max ({bounds} um)",
                "expected it between them",
            )
        elif inner_high is None:
            self._tail(size, distribution, radius, host)

    def _tail(self, size: Mapping, distribution: str | None, radius: float | None, host: Index | None) -> None:
        """The largest spheres of a distribution without `max` that count at the recipe's tolerance."""
        width, tolerance = {"lognormal": "sigma", "gamma": "variance"}.get(distribution, ""), self.values.get("tolerance", 0.01)
        value = self.value(size, width)
        if value is None or radius is None or tolerance is None or host is None or self.wavelength is None:
            return
        from bakery.physics.sizes import Gamma, Lognormal, tails
        from bakery.physics.sizes.distributions import Part

        k = 2 * math.pi * host.n / np.array(self.wavelength)
        if radius * k.max() > LARGEST:
            return  # said of the radius
        law = (Lognormal if distribution == "lognormal" else Gamma)(radius, value)
        largest = tails(Part(law, 1.0), k, tolerance)[1]
        if largest * k.max() > LARGEST:
            cut = math.floor(LARGEST / k.max())
            self.report(
                size[width],
                f"found a tail in which radii up to {largest:.3g} um (size parameter {largest * k.max():.3g}) count at a "
                f"tolerance of {tolerance:g}",
                f"expected size parameters up to {LARGEST:g}; a cut (max: {cut} um) or a smaller {width} would do",
            )

    def _size_table(self, size: Mapping, host: Index | None, low: float | None, high: float | None) -> None:
        columns = self._table(size.get("file"), tables.SIZES)
        if columns is None:
            return
        radius, density = columns
        if not density.max() > 0:
            self.report(size["file"], "found a density that is zero everywhere", "expected a positive density")
            return
        used = np.flatnonzero(density > 0)
        first, last = radius[max(used[0] - 1, 0)], radius[min(used[-1] + 1, len(radius) - 1)]
        if low is not None and last <= low or high is not None and first >= high:
            self.report(
                size["file"], f"found densities from {first:g} to {last:g} um, all outside of min and max", "expected an overlap"
            )
        for value in (radius[radius > 0][0], last if high is None else min(last, high)):
            self._size_parameter(size["file"], f"radius of {value:g} um in the table", float(value), host)

    def _size_parameter(self, node: Node, what: str, radius: float, host: Index | None) -> None:
        if host is None or self.wavelength is None:
            return
        scale = 2 * math.pi * host.n / np.array(self.wavelength)
        low, high = radius * float(scale.min()), radius * float(scale.max())  # Python's floats overflow in silence
        if low < SMALLEST or high > LARGEST:
            x, least, most = (low if low < SMALLEST else high), SMALLEST / scale.min(), LARGEST / scale.max()
            self.report(
                node,
                f"found a {what}, size parameter {x:.3g}",
                f"expected size parameters {SMALLEST:g} to {LARGEST:g}, here {least:.3g} to {most:.3g} um",
            )

    def _medium(self, section: Mapping) -> None:
        first, second = given(section, "albedo", "mean_free_path"), given(section, "sigma_s", "sigma_a")
        want = "expected albedo and mean_free_path, or sigma_s and sigma_a"
        if first and second:
            node = section.get(second[0], section)
            self.report_section(node, f"found {' and '.join(second)} beside {' and '.join(first)}", want)
        elif len(first or second) < 2:
            self.report_section(
                section, f"found only {(first or second)[0]}" if first or second else "found no coefficients", want
            )
        _, path, s, a = (self.one_each(section, name) for name in ("albedo", "mean_free_path", "sigma_s", "sigma_a"))
        if s is not None and a is not None and ((s == 0) & (a == 0)).any():
            self.report_section(section, "found sigma_s and sigma_a that are both 0", "expected a positive sum")
        elif s is not None and a is not None and not all(1e-24 < sum(pair) < 1e15 for pair in zip(s.tolist(), a.tolist())):
            self.report_section(
                section, "found sigma_s and sigma_a with a sum that no medium has", "expected 1e-24 /m to 1e15 /m"
            )
        if path is not None and not ((path > 1e-9) & (path < 1e30)).all():
            self.report(section["mean_free_path"], "found a mean free path that no medium has", "expected 1e-15 m to 1e24 m")
        for phase in _mappings(section.get("phase")):
            g = self.one_each(phase, "g")
            if g is not None and np.abs(g).max() > STEEPEST:
                steepest = float(g[np.abs(g).argmax()])
                self.report(phase["g"], f"found g = {steepest!r}, a lobe too narrow for a table", "expected |g| up to 1 - 1e-9")
            if self.value(phase, "type") == "table":
                self._phase_table(phase)

    def _phase_table(self, phase: Mapping) -> None:
        columns = self._table(phase.get("file"), tables.PHASE)
        if columns is None:
            return
        theta, value = columns
        if not value.max() > 0:
            self.report(phase["file"], "found a phase function that is zero everywhere", "expected positive values")
        if theta[0] > 1e-9 or abs(theta[-1] - math.pi) > 1e-6:
            ends = " to ".join(f"{math.degrees(v):g}" for v in theta[[0, -1]])
            self.report(phase["file"], f"found angles from {ends} deg", "expected 0 to 180 deg")
            return
        theta[0], theta[-1] = 0.0, math.pi
        if not theta[-2] < math.pi:
            self.report(phase["file"], "found two angles of 180 deg", "expected ascending order")

    def _packing(self, section: Mapping) -> None:
        beside = next((name for name in ("particles", "medium") if name in self.tree), None)
        if beside:
            self.report_section(section, f"found packing beside {beside}, which it has no effect on",
                                 "expected it alone or with grains")
        node = section.get("fraction")
        fractions = self.several(node) or ()
        shown = [f"{100 * f:g}" for f in fractions]
        for i, f in enumerate(shown):
            if f in shown[:i]:
                self.report(node[i] if isinstance(node, Sequence) else node, f"found {f} % more than once",
                             "expected distinct fractions")
        radii = self._radii(section)
        cell = self.several(section.get("cell"))
        if radii is not None and ("cell" not in section or cell is not None and len(cell) == 3):
            for i, f in enumerate(fractions):
                self._tile(node[i] if isinstance(node, Sequence) else node, f, radii, cell or (1.0, 1.0, 1.0))

    def _radii(self, section: Mapping) -> np.ndarray | None:
        """Relative radii of the spheres of a tile, (count,)."""
        from bakery.physics.packing import radii

        node = section.get("radii")
        count = self.value(section, "count") if "count" in section else 500
        if isinstance(node, Sequence):
            parts = list(_mappings(*node))
            shares, sizes = ([self.value(part, name) for part in parts] for name in ("share", "radius"))
            if len(parts) < len(node) or not parts or None in shares or None in sizes:
                return None
            self._shares(node, "share", parts, None)
            if count is None or abs(math.fsum(shares) - 1) > _SHARES:
                return None
            try:
                return radii.species(shares, sizes, count)
            except ValueError as error:
                self.report_section(node, f"found {error}", "expected shares of at least one sphere, or a larger packing.count")
                return None
        if count is None:
            return None
        if isinstance(node, Mapping):
            sigma = self.value(node, "sigma")
            return None if sigma is None else radii.lognormal(sigma, count)
        return np.ones(count)

    def _tile(self, node: Node, fraction: float, radii: np.ndarray, cell: tuple) -> None:
        """Whether spheres can be packed so far, in a cell of these proportions."""
        from bakery.physics.packing.ceiling import limit
        from bakery.physics.packing.radii import room

        most = limit(radii)
        if fraction > most:
            equal = np.ptp(radii) < 1e-9
            what = "equal spheres" if equal else "these radii"
            more = "; several sizes reach more (packing.radii)" if equal else ""
            self.report(node, f"found {fraction:g}", f"expected at most {most:.4g}, as far as {what} are packed at random{more}")
            return
        width = room(fraction, radii, cell)
        if width <= 1 + 1e-6:
            spheres = f"the largest of {radii.size:,} spheres" if radii.size > 1 else "the sphere"
            most = 0.999 * fraction * width**3
            self.report(
                node,
                f"found {fraction:g}, where {spheres} meets its own image: the cell is {width:.3g} of its diameter wide",
                f"expected less than {most:.3g}, a larger packing.count, or a packing.cell nearer to a cube",
            )

    # ---- files

    def index(self, section: Mapping, name: str, default: str | None = None) -> Index | None:
        """Optical constants at the recipe's wavelengths, from a name, {n, k} or a file."""
        node, key = section.get(name), f"{section.place.key}.{name}"
        if isinstance(node, Mapping) and "file" in node:
            table = self._table(node["file"], tables.INDEX)
            found = self._interpolate(node["file"], self.value(node, "file"), table)
        elif isinstance(node, Mapping):
            n, k = self.one_each(node, "n"), self.one_each(node, "k")
            k = np.zeros(len(self.wavelength)) if "k" not in node and self.wavelength else k
            found = None if n is None or k is None else Index("n, k", n, k)
        else:
            word = default if node is None else self.values.get(key)
            found = None if word is None else self._named(node, section, key, word)
        if found is not None:
            self.indices[key] = found
        return found

    def _named(self, node: Node | None, section: Mapping, key: str, word: str) -> Index | None:
        known = materials()
        if word not in known:
            self.report(
                node or section,
                f"found {show(word)}, an unknown material",
                f"expected {', '.join(known)}, or {{n: …, k: …}}, or {{file: …}}" + nearest(word, known),
            )
            return None
        anchor = node or section
        try:
            data, file = self.folder.material(key, word)
            table = tables.read(data, f"assets/materials/{word}.csv", key, tables.INDEX)
        except Wrong as wrong:
            self.report(anchor, wrong.found, wrong.expected)
            return None
        except tables.BadTable as bad:
            self.problems += bad.problems
            return None
        self.files.append(file)
        return self._interpolate(anchor, word, table)

    def _interpolate(self, node: Node, word: str, table: np.ndarray | None) -> Index | None:
        if table is None or self.wavelength is None:
            return None
        wavelength, n = table[:2]
        k = table[2] if len(table) == 3 else np.zeros_like(n)
        if n.max() > 1000 or k.max() > 1000:
            self.report(node, f"found n or k up to {max(n.max(), k.max()):g} in the table", "expected at most 1000")
            return None
        if n.min() < SMALLEST_N:
            self.report(node, f"found n down to {n.min():g} in the table", f"expected at least {SMALLEST_N:g}")
            return None
        outside = [w for w in self.wavelength if not wavelength[0] <= w <= wavelength[-1]]
        if outside:
            near, shown = wavelengths.likely(outside), wavelengths.listed(outside)
            self.report(
                node,
                f"found the wavelength{'s' * (len(outside) > 1)} {shown} um, for which {show(word)} has no data",
                f"expected {wavelength[0]:g} to {wavelength[-1]:g} um" + (f" ({near}?)" if near else ""),
            )
            return None
        return Index(word, *constants(Table(wavelength, n, k), self.wavelength))

    def _table(self, node: Node | None, columns: tuple[tables.Column, ...]) -> np.ndarray | None:
        name = None if node is None else self.values.get(node.place.key)
        if name is None:
            return None
        key = node.place.key
        try:
            data, file = self.folder.read(key, name)
            self.columns[key] = tables.read(data, show(name, 300)[1:-1], key, columns)
        except Wrong as wrong:
            self.report(node, wrong.found, wrong.expected)
            return None
        except tables.BadTable as bad:
            self.problems += bad.problems
            return None
        self.files.append(file)
        return self.columns[key]


def _mappings(*nodes: Node | None) -> Iterator[Mapping]:
    return (node for node in nodes if isinstance(node, Mapping))
