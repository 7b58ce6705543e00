"""Runs the checks of a recipe's sections, and gives them their tools.

The checks see the tree and the values that were well formed (dotted key -> value), so they say what they can even where other
keys are wrong.  A key that is missing or malformed is passed over here: the schema has reported it.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from bakery.errors import AssetError, Problem, RecipeError, StoreError
from bakery.grammar import bins, index_files, tables
from bakery.grammar.fields import SUM_OF_SHARES, nearest
from bakery.grammar.files import DataFile, Folder, materials
from bakery.grammar.section import SMALLEST_N, meant
from bakery.grammar.text import Mapping, Node, Sequence, mappings, owner, show
from bakery.grammar.units import Wrong
from bakery.grammar.values import Index, frozen
from bakery.physics.materials import formulas
from bakery.physics.materials.mixing import RULES, mixed
from bakery.recipe import wavelengths
from bakery.recipe.dispersion import Outside, constants_at
from bakery.recipe.model import Recipe
from bakery.recipe.schema import NAMED_WAVELENGTHS
from bakery.stages import all_stages, conform
from bakery.stages.declaration import RecipeSection, Stage

LARGEST_ASSET = 512 << 20  # bytes of one that a recipe names
LARGEST_N = 1000.0  # of n and k
CLEAR = 1e-3  # largest k of a host: above it, cross sections of a sphere in it are not defined by Lorenz-Mie theory


@dataclass(frozen=True)
class Named:
    """A recipe that another one names: its stages, and its file."""

    recipe: Recipe
    stages: tuple[Stage, ...]
    file: DataFile


@dataclass
class Checker:
    """Runs the checks; then `problems`, `warnings`, `files` and `found` (what stands behind a key: optical constants, columns,
    meshes) hold what was found."""

    tree: Mapping
    values: dict
    folder: Folder
    sections: tuple[RecipeSection, ...]
    problems: list[Problem] = field(default_factory=list)
    warnings: list[Problem] = field(default_factory=list)
    files: list[DataFile] = field(default_factory=list)
    found: dict = field(default_factory=dict)
    meshes: dict[str, tuple[bytes, str]] = field(default_factory=dict)
    wavelength: tuple[float, ...] | None = None
    read: Callable | None = None  # (path) -> the checked recipe of a file

    def run(self) -> None:
        self._wavelengths()
        self._scattering()
        for section in self.sections:
            for mapping in mappings(self.tree.get(section.name)):
                section.check(self, mapping)
        self._unusual_wavelengths()

    @property
    def scattering(self) -> list[str]:
        """Names of the sections that say what scatters."""
        return [section.name for section in self.sections if section.scatters]

    def _scattering(self) -> None:
        names = self.scattering
        present = [name for name in names if name in self.tree]
        expected = f"expected exactly one of {', '.join(names)}"
        if not present and not any(section.alone and section.name in self.tree for section in self.sections):
            self.problems.append(self.tree.place.problem("found nothing that scatters", expected, key=""))
        for name in present[1:]:
            self.report_section(self.tree[name], f"found {name} beside {present[0]}", expected)

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
            values = tuple(self.values.get(item.place.key) for item in node)
            return values if values and None not in values else None
        return None if node is None else self.values.get(node.place.key)

    def one_each(self, section: Mapping, name: str) -> np.ndarray | None:
        """A key with one value for all wavelengths or one for each, (L,)."""
        values = self.several(section.get(name))
        if values is None or self.wavelength is None:
            return None
        count = len(self.wavelength)
        if len(values) not in (1, count):
            self.report(section[name], f"found {len(values)} values for {count} wavelength{'s' * (count != 1)}",
                        "expected one value, or one a wavelength")
            return None
        per_wavelength = np.array(values * count if len(values) == 1 else values, dtype=float)
        self.found[section[name].place.key] = per_wavelength
        return per_wavelength

    def only_with(self, section: Mapping, partner: str) -> None:
        """A section that has no effect without another one."""
        if partner not in self.tree:
            self.report_section(section, f"found {section.place.key} without {partner}", f"expected it with {partner} only")

    def needs_scattering(self, section: Mapping) -> None:
        """A section that needs something that scatters beside it."""
        names = self.scattering
        if not any(name in self.tree for name in names):
            self.report_section(section, f"found {section.place.key} without anything that scatters",
                                f"expected {', '.join(names[:-1])} or {names[-1]} beside it")

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
            self.report(section.get("host", section), f"found a host that absorbs (k = {host.k.max():.3g})",
                        f"expected a clear host, k at most {CLEAR:g}")
        return host

    def components(self, section: Mapping, share: str = "") -> list[Mapping]:
        """The mappings in a list of components, whose names, and shares where they have a key, are checked."""
        node = section.get("components")
        parts = list(mappings(*node)) if isinstance(node, Sequence) else []
        seen: dict[str, str] = {}
        for part in parts:
            name = self.value(part, "name")
            # two names that differ in case alone are one file on some systems
            if name is not None and name.lower() in seen:
                self.report(part["name"], f"found {show(name)} a second time (first in {seen[name.lower()]})",
                            "expected distinct names")
            elif name is not None:
                seen[name.lower()] = str(part["name"].place)
        if share and parts and len(parts) == len(node):
            self.shares(node, share, parts, 1.0)
        return parts

    def shares(self, node: Sequence, name: str, parts: list[Mapping], default: float | None) -> None:
        """Shares of a list of parts that have to add up to 1."""
        if any(name in meant(part) for part in parts):
            return
        shares = [self.value(part, name) if name in part else default for part in parts]
        if None not in shares and abs(math.fsum(shares) - 1) > SUM_OF_SHARES:
            self.report_section(node, f"found {name}s that add up to {math.fsum(shares):.7g}", "expected 1")

    # ---- files

    @contextmanager
    def _told(self, node: Node) -> Iterator[None]:
        """What is wrong with a file, inside of the `with`, as a problem of the node that names it; the `with` ends there."""
        try:
            yield
        except Wrong as wrong:
            self.report(node, wrong.found, wrong.expected)
        except tables.BadTable as bad:
            self.problems += bad.problems

    def index(self, section: Mapping, name: str, default: str | None = None) -> Index | None:
        """Optical constants at the recipe's wavelengths, from a name, {n, k} or a file."""
        node, key = section.get(name), f"{section.place.key}.{name}"
        if isinstance(node, Mapping) and "file" in node:
            refractive = self._of_file(node)
        elif isinstance(node, Mapping) and ("mixing" in node or "of" in node):
            refractive = self._mixture(node)
        elif isinstance(node, Mapping):
            n, k = self.one_each(node, "n"), self.one_each(node, "k")
            k = np.zeros(len(self.wavelength)) if "k" not in node and self.wavelength else k
            refractive = None if n is None or k is None else Index("n, k", frozen(n), frozen(k))
        else:
            word = default if node is None else self.values.get(key)
            refractive = None if word is None else self._named(node, section, key, word)
        if refractive is not None:
            self.found[key] = refractive
        return refractive

    def _mixture(self, node: Mapping) -> Index | None:
        """Optical constants of several materials that are mixed finely."""
        rule, of = self.value(node, "mixing"), node.get("of")
        parts = list(mappings(*of)) if isinstance(of, Sequence) else []
        index = [self.index(part, "material") for part in parts if "material" in part]
        shares = [self.value(part, "share") for part in parts]
        matrix = self.index(node, "matrix") if "matrix" in node else None
        if rule is None or not parts or len(parts) != len(of) or not self._fills(node, rule, of, parts, shares):
            return None
        if None in index or None in shares or len(index) != len(parts) or "matrix" in node and matrix is None:
            return None
        whole = math.fsum(shares) if matrix is None else 1.0
        around = None if matrix is None else matrix.n + 1j * matrix.k
        try:
            values = mixed(rule, [part.n + 1j * part.k for part in index], np.array(shares) / whole, around)
        except ValueError as error:
            self.report_section(node, f"found a mixture without an index ({error})", f"expected another of {', '.join(RULES)}")
            return None
        return Index(rule, frozen(values.real), frozen(np.maximum(values.imag, 0.0)))

    def _fills(self, node: Mapping, rule: str, of: Sequence, parts: list[Mapping], shares: list) -> bool:
        """Whether the parts of a mixture fill its volume, with a matrix where its rule has one."""
        inside = rule == "maxwell_garnett"
        if inside != ("matrix" in node):
            self.report_section(node.get("matrix", node), f"found {rule} with{'out' * inside} a matrix",
                                "expected matrix: the material of the rest" if inside else "expected it with maxwell_garnett")
            return False
        if not inside:
            self.shares(of, "share", parts, None)
        elif None not in shares and math.fsum(shares) >= 1:
            self.report_section(of, f"found shares that add up to {math.fsum(shares):.7g}", "expected less than 1 in a matrix")
            return False
        return True

    def _named(self, node: Node | None, section: Mapping, key: str, word: str) -> Index | None:
        names = materials()
        if word not in names:
            self.report(node or section, f"found {show(word)}, an unknown material",
                        f"expected {', '.join(names)}, or {{n: …, k: …}}, or {{file: …}}" + nearest(word, names))
            return None
        with self._told(node or section):
            data, file = self.folder.material(key, word)
            table = tables.read(data, f"assets/materials/{word}.csv", key, tables.INDEX)
            self.files.append(file)
            return self._interpolate(node or section, word, table)
        return None

    def _of_file(self, node: Mapping) -> Index | None:
        """Constants of a table of our own form, or of somebody else's file."""
        name, where = self.value(node, "file"), node["file"]
        if name is None:
            return None
        with self._told(where):
            data, file = self.folder.read(where.place.key, name)
            if not index_files.is_foreign(data, name):
                return self._interpolate(where, name, self.table(where, tables.INDEX), self._in_air(node, None))
            constants = index_files.read(data, name, where.place.key, formulas.FEWEST, formulas.MOST)
            self.files.append(file)
            if constants.k is None:
                self.warnings.append(where.place.problem(
                    f"found no k in {show(name)}: it is taken as clear", "is that meant? a CSV of wavelength_um,n,k has both"))
            return self._at_wavelengths(where, name, constants, self._in_air(node, constants.in_air))
        return None

    def _in_air(self, node: Mapping, stated: bool | None) -> bool:
        """Whether n of a file is relative to air: the recipe's word, then the file's; else it is relative to vacuum."""
        word = self.value(node, "relative_to")
        return bool(stated) if word is None else word == "air"

    def _interpolate(self, node: Node, word: str, table: np.ndarray | None, in_air: bool = False) -> Index | None:
        if table is None:
            return None
        wavelength, n = table[:2]
        k = table[2] if len(table) == 3 else np.zeros_like(n)
        if n.max() > LARGEST_N or k.max() > LARGEST_N:
            self.report(node, f"found n or k up to {max(n.max(), k.max()):g} in the table", f"expected at most {LARGEST_N:g}")
            return None
        if n.min() < SMALLEST_N:
            self.report(node, f"found n down to {n.min():g} in the table", f"expected at least {SMALLEST_N:g}")
            return None
        columns = (index_files.Tabulated(wavelength, values) for values in (n, k))
        return self._at_wavelengths(node, word, index_files.Constants(*columns), in_air)

    def _at_wavelengths(self, node: Node, word: str, constants: index_files.Constants, in_air: bool) -> Index | None:
        """Constants at the recipe's wavelengths, which the file has to cover."""
        if self.wavelength is None:
            return None
        try:
            n, k = constants_at(constants, self.wavelength, in_air)
        except Outside as outside:
            near, shown = wavelengths.likely(outside.wavelengths), wavelengths.listed(outside.wavelengths)
            self.report(
                node,
                f"found the wavelength{'s' * (len(outside.wavelengths) > 1)} {shown} um, for which {show(word)} has no data",
                f"expected {outside.low:g} to {outside.high:g} um" + (f" ({near}?)" if near else ""),
            )
            return None
        for name, values, least in (("n", n, SMALLEST_N), ("k", k, 0.0)):
            wrong = ~((values >= least) & (values <= LARGEST_N))
            if wrong.any():
                at = self.wavelength[int(np.argmax(wrong))]
                self.report(node, f"found {name} = {values[wrong][0]:g} at {at:g} um in {show(word)}",
                            f"expected {least:g} to {LARGEST_N:g}")
                return None
        return Index(word, frozen(n), frozen(k))

    def table(self, node: Node | None, columns: tuple[tables.Column, ...]) -> np.ndarray | None:
        """The columns of the CSV file that a key names."""
        return self._file(node, lambda data, label, key: tables.read(data, label, key, columns))

    def bins(self, node: Node | None) -> bins.Bins | None:
        """The bins of the CSV file that a key names."""
        return self._file(node, bins.read)

    def asset(self, node: Node):
        """The tree of the asset that a key names, as its stages declare it, and its file; raises `Wrong`."""
        name = self.values[node.place.key]
        data, file = self.folder.read(node.place.key, name, LARGEST_ASSET, "file")
        try:
            root = conform.parsed(name, data)
        except (AssetError, StoreError) as fault:
            raise Wrong(f"found a file that is damaged or no asset ({fault})", "expected what `bake` wrote") from None
        return root, file

    def recipe(self, node: Node) -> Named | None:
        """The recipe that a key names, checked; None where it is wrong.  Raises `Wrong`."""
        name = self.values[node.place.key]
        _, file = self.folder.read(node.place.key, name, noun="recipe")
        try:
            recipe = self.read(file.path)
        except RecipeError as error:
            self.problems += error.problems
            return None
        return Named(recipe, tuple(stage for stage in all_stages() if stage.applies(recipe)), file)

    def _file(self, node: Node | None, read):
        """What `read(data, label, key)` makes of the file that a key names."""
        name = None if node is None else self.values.get(node.place.key)
        if name is None:
            return None
        key = node.place.key
        with self._told(node):
            data, file = self.folder.read(key, name)
            self.found[key] = read(data, show(name, 300)[1:-1], key)
            self.files.append(file)
        return self.found.get(key)
