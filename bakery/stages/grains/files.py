"""Figures of grains as CSV, one file a component."""

from bakery.draw.files import csv_text
from bakery.store.tree import Dataset, Group


def csv_figures(root: Group) -> tuple[dict[str, str], set[str]]:
    """File name -> text of the single figures of grains and their medium, and of figures by size; the paths written in them."""
    files, written = {}, set()
    grains, medium = root["grains"], root.members.get("medium")
    groups = {f"grains/{name}": part for name, part in grains.groups.items()}
    if isinstance(medium, Group):
        groups["medium"] = medium
        groups |= {f"medium/{name}": part for name, part in medium.groups.items()}
    for path, group in groups.items():
        single = {key: member for key, member in group.datasets.items()
                  if member.data.shape == (1,) and member.data.dtype.kind in "fiu"}
        rows = [(key, float(member.data[0]), float(single[f"{key}_error"].data[0]) if f"{key}_error" in single else "",
                 member.units, member.description) for key, member in single.items() if key.removesuffix("_error") not in single
                or not key.endswith("_error")]
        if rows:
            head = ("figure", "value", "standard error", "unit", "what it is")
            files[f"{path.replace('/', '_')}_figures.csv"] = csv_text(list(zip(head, zip(*rows, strict=True), strict=True)))
            written |= {f"{path}/{key}" for key in single}
        table, names = _by_radius(root, grains, group)
        if table:
            files[f"{path.replace('/', '_')}_by_radius.csv"] = csv_text(table)
            written |= {f"{path}/by_radius/{name}" for name in names}
    return files, written


def _by_radius(root: Group, grains: Group, part: Group) -> tuple[list, list[str]]:
    """Columns of a component's figures by size (S, L): one a figure and wavelength; and their names."""
    sized, radius, um = part.members.get("by_radius"), grains.members.get("radius"), root["wavelength"].data
    if not isinstance(sized, Group) or not isinstance(radius, Dataset):
        return [], []
    names = [name for name, member in sized.datasets.items() if member.data.shape == (radius.data.size, um.size)]
    columns = [(f"radius [{radius.units}]", radius.data)]
    columns += [(f"{name} at {x:g} um [{sized[name].units}]", sized[name].data[:, k]) for name in names for k, x in enumerate(um)]
    return columns if names else [], names
