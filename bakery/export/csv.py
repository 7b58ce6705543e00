"""Every table of an asset as CSV: one file for each coordinate of each group, units in the headings."""

import numpy as np

from bakery.asset.axes import axes
from bakery.asset.summary import describe
from bakery.draw.files import csv_text
from bakery.stages.conform import stages_of
from bakery.stages.coordinates import COORDINATES, coordinate
from bakery.store.tree import Dataset, Group, is_text, read_text


def csv_files(root: Group) -> dict[str, str]:
    """File names (without the asset's) and their text; all of an asset but its provenance.

    A file `medium_by_theta.csv` has one row an angle and one column for each dataset of the group over that coordinate and, where
    it depends on it, each wavelength.  What has no coordinate gets a file of its own.
    """
    files = {"recipe.yaml": read_text(root["recipe"])} if "recipe" in root.members else {}
    written: set[str] = set()
    for stage in stages_of(root):
        texts, paths = stage.files(root)
        files |= texts
        written |= set(paths)
    tables: dict[str, list] = {}
    for path, member in root.walk():
        if not isinstance(member, Dataset) or path in written \
                or path.split("/")[0] in ("provenance", "recipe", "wavelength"):
            continue
        group = path.rpartition("/")[0].replace("/", "_")
        letters = axes(root, path)
        if is_text(member):
            files[f"{path.replace('/', '_')}.txt"] = read_text(member)
        elif letters[-1] != "-" and set(letters[:-1]) <= {"L"} and len(letters) <= 2:
            where, values = coordinate(root, path, letters[-1])
            name = COORDINATES[letters[-1]]
            table = tables.setdefault(f"{group}_by_{name}", [(f"{name} [{values.units}]", values.data)])
            if where != path:
                table += _columns(path, member, root["wavelength"].data, letters)
        else:
            files[f"{path.replace('/', '_')}.csv"] = csv_text(_plain(path, member))
    files |= {f"{name}.csv": csv_text(columns) for name, columns in tables.items()}
    stages = describe(root)["stages"]
    if stages:
        keys = ("group", "stage_version", "tolerance", "achieved_error", "error_measure", "input_hash", "content_hash")
        files["stages.csv"] = csv_text([(key, [stage[key] for stage in stages]) for key in keys])
    return files


def _columns(path: str, member: Dataset, um, letters) -> list:
    """The columns of a dataset whose last axis is the rows."""
    name, data = path.rpartition("/")[2], _values(member)
    if len(letters) == 1:
        return [(f"{name} [{member.units}]", data)]
    return [(f"{name} at {x:g} um [{member.units}]", row) for x, row in zip(um, data, strict=True)]


def _plain(path: str, member: Dataset) -> list:
    """A dataset without coordinates: an array of rows as columns, anything with more axes as indices and value."""
    name, data = path.rpartition("/")[2], _values(member)
    if data.ndim == 1:
        return [(f"{name} [{member.units}]", data)]
    if data.ndim == 2:
        return [(f"{name} {i} [{member.units}]", data[:, i]) for i in range(data.shape[1])]
    index = np.indices(data.shape).reshape(data.ndim, -1)
    return [*((f"index {i}", row) for i, row in enumerate(index)), (f"{name} [{member.units}]", data.reshape(-1))]


def _values(member: Dataset) -> np.ndarray:
    """Numbers, or the names of an enumeration."""
    return np.array(member.choices)[member.data.astype(int)] if member.choices else member.data
