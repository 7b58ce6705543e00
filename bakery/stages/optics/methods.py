"""Where rays stood in for the series: read from what the stage `optics` recorded, in words and as values."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from bakery.stages.coordinates import coordinate
from bakery.stages.declaration import Remark
from bakery.store.tree import Dataset, Group

RAYS = "goa"
_NAMES = {"rayleigh": "Rayleigh", "mie": "Mie"}
_BY_LIGHT = ("g", "sigma_t_reduced", "albedo_reduced", "sigma_tr")  # cross sections are the series' own at every size
_OF_A_SPHERE = {"goa": "goa (amplitudes by rays, cross sections by the series)"}


@dataclass(frozen=True)
class Boundary:
    """The change from series to rays in one component at one wavelength."""

    component: str
    wavelength: float  # um
    radius: float  # um, the smallest node that was computed by rays
    below: str  # how smaller ones were computed, in words; "" where there are none
    size_parameter: float | None  # 1, from which rays are taken; None where the asset does not say
    error: float | None  # 1, integral of the difference to the series' phase function over the sphere; None likewise

    def as_dict(self) -> dict:
        """The same for machines (`--json`)."""
        values = asdict(self)
        return {f"{key}_um" if key in ("wavelength", "radius") else key: value for key, value in values.items()}


def components(root: Group) -> Iterator[tuple[str, Group]]:
    """The components of an asset whose sizes and methods are stored."""
    optics = root.members.get("optics")
    for name, member in (optics.members if isinstance(optics, Group) else {}).items():
        if isinstance(member, Group):
            yield name, member


def boundaries(name: str, component: Group, wavelength) -> list[Boundary]:
    """One for each wavelength at which rays took part."""
    method, radius, limits = component["method"], component["radius"].data, []
    for i, um in enumerate(wavelength):
        rays = method.data[i] == method.choices.index(RAYS)
        if not rays.any():
            continue
        others = [choice for j, choice in enumerate(method.choices) if choice != RAYS and (method.data[i] == j).any()]
        limits.append(Boundary(name, float(um), float(radius[rays].min()), " and ".join(_NAMES.get(key, key) for key in others),
                              _at(component, "switch", i), _at(component, "ray_difference", i)))
    return limits


def _at(component: Group, name: str, i: int) -> float | None:
    value = float(component[name].data[i]) if name in component.members else 0.0
    return value if value > 0 or name != "switch" and name in component.members else None


def sentence(limits: Sequence[Boundary], partly: bool) -> str:
    """The boundaries of one component in a line; `some` where other wavelengths have none."""
    where = f" at {_list(b.wavelength for b in limits)} um" if partly else ""
    radii = _list(b.radius for b in limits)
    size_parameters = [b.size_parameter for b in limits if b.size_parameter is not None]
    x = f" (x = {_list(size_parameters)})" if size_parameters else ""
    head = f"{limits[0].below} below {radii} um{x}, rays above" if limits[0].below else f"rays throughout, from {radii} um{x}"
    errors = [b.error for b in limits if b.error is not None]
    differ = f"; rays differ by {'up to ' if len(errors) > 1 else ''}{100 * max(errors):.2g} %" if errors else ""
    return f"{limits[0].component}{where}: {head}{differ}"


def remarks(root: Group, path: str, letters: Sequence[str], arguments: Mapping) -> list[Remark]:
    """How values at a path were computed: the methods of the spheres that were asked for, or where rays stood in."""
    if "L" not in letters or root[path].choices:
        return []
    wanted = arguments.get("wavelength")
    if "radius" in arguments:
        return _of_nodes(root, path, arguments["radius"], wanted)
    um = root["wavelength"].data
    return [Remark(sentence(limits, len(limits) < len(rows(um, wanted))), tuple(boundary.as_dict() for boundary in limits))
            for limits in concerned(root, path, letters, wanted)]


def _of_nodes(root: Group, path: str, radius, wanted) -> list[Remark]:
    """How the spheres nearest to radii (um) were computed, where `path` holds a figure of single spheres."""
    try:
        method = root[path.rpartition("/")[0] + "/method"]
    except KeyError:
        return []
    if not method.choices or method.data.shape != root[path].data.shape:
        return []
    index = np.argmin(np.abs(coordinate(root, path, "R")[1].data - np.atleast_1d(radius)[:, None]), axis=-1)
    taken = method.data[np.ix_(rows(root["wavelength"].data, wanted), index)]
    return [Remark(of_spheres(np.array(method.choices)[taken.reshape(-1).astype(int)].tolist()))]


def concerned(root: Group, path: str, letters: Sequence[str], wanted=None) -> list[list[Boundary]]:
    """The boundaries behind a dataset, by component: those of all components for `medium`, of its own below `optics`.

    Only what depends on how light is spread over the angles has any.  `wanted`: wavelengths (um) that were asked for; the stored
    ones on either side count.
    """
    group, _, member = path.partition("/")
    wavelength = root.members.get("wavelength")
    if group not in ("medium", "optics") or not isinstance(wavelength, Dataset) \
            or not (tuple(letters) == ("L", "A") or path.rpartition("/")[2] in _BY_LIGHT):
        return []
    um = wavelength.data
    near = set(um[rows(um, wanted)].tolist())
    by_component = [boundaries(name, component, um) for name, component in components(root)
                    if group == "medium" or member.startswith(f"{name}/")]
    chosen = [[b for b in boundaries_of if b.wavelength in near] for boundaries_of in by_component]
    return [boundaries_of for boundaries_of in chosen if boundaries_of]


def of_spheres(methods: Iterable[str]) -> str:
    """The methods of single spheres, in words."""
    return "method: " + ", ".join(_OF_A_SPHERE.get(name, name) for name in dict.fromkeys(methods))


def rows(um, wanted=None) -> list[int]:
    """Which stored wavelengths (um) values at the wanted ones come from: the same, or those on either side."""
    if wanted is None:
        return list(range(len(um)))
    taken = set()
    for x in np.atleast_1d(wanted):
        gap = um - x
        if np.min(np.abs(gap)) <= 1e-9 * x:
            taken.add(int(np.argmin(np.abs(gap))))
            continue
        taken |= {int(np.argmin(np.where(side, np.abs(gap), np.inf))) for side in (gap < 0, gap > 0) if side.any()}
    return sorted(taken)


def _list(values) -> str:
    return ", ".join(dict.fromkeys(f"{value:.3g}" if value < 999.5 else f"{value:.0f}" for value in values))
