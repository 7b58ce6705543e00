"""What the group `multiple` can be asked: light scattered three times and more around a source."""

from __future__ import annotations

import numpy as np

from bakery.physics.multiple.kinds import KINDS
from bakery.stages.members import Members, MissingStage, medium_theta
from bakery.store.tree import Group


def view(root: Group) -> Multiple:
    """The group as `bakery.open` gives it; its phase functions stand over the angles of the medium."""
    return Multiple(root["multiple"], medium_theta(root), root["wavelength"].data)


class Multiple(Members):
    """The group `multiple`: light of third and later events around a source, in an infinite medium.

    Attributes
    ----------
    point, segment : `Source`, can be called with a position and a direction

    Notes
    -----
    The four queries take positions in mean free paths of the medium, (..., 3), and unit vectors along which light travels, and
    broadcast.  They return (L, ...) for a source of unit power.
    """

    def __init__(self, group: Group, theta: np.ndarray | None, wavelength: np.ndarray):
        super().__init__(group, "multiple", theta, wavelength)
        self._sources = {kind: Source(group, kind) for kind in KINDS if kind in group.members}

    def __getattr__(self, name: str):
        sources = self.__dict__.get("_sources", {})
        if name in KINDS and name not in sources:
            raise AttributeError(f"multiple holds no {name!r}; bake it with multiple_scattering: {{sources: [point, segment]}}")
        return sources[name] if name in sources else super().__getattr__(name)

    def point_to_point(self, vertex, incoming, target, outgoing) -> np.ndarray:
        """In-scattered light at `target` into `outgoing`, mfp^-3 sr^-1.

        The power enters a collision at `vertex`, travelling along `incoming`.
        """
        return self._asked("point_to_point", (vertex, target), (incoming, outgoing))

    def segment_to_point(self, origin, direction, length, target, outgoing) -> np.ndarray:
        """The same of a beam from `origin` along `direction`, whose first events within `length` (mean free paths) count."""
        return self._asked("segment_to_point", (origin, target), (direction, outgoing), length)

    def point_to_segment(self, vertex, incoming, eye, view, distance) -> np.ndarray:
        """Radiance that reaches `eye` against `view`, mfp^-2 sr^-1.

        The line of sight's integral of point_to_point within `distance` (mean free paths), attenuated up to the viewer.
        """
        return self._asked("point_to_segment", (vertex, eye), (incoming, view), distance)

    def segment_to_segment(self, origin, direction, length, eye, view, distance) -> np.ndarray:
        """The same from a beam."""
        return self._asked("segment_to_segment", (origin, eye), (direction, view), length, distance)

    def _asked(self, name, places, directions, *lengths):
        from bakery.physics.multiple import queries

        kind, _, target = name.split("_")
        if kind not in self._sources:
            raise MissingStage(f"the tables hold no {kind} source; bake them with "
                               "multiple_scattering: {sources: [point, segment]}")
        answers = []
        for point, segment, stretch in self._sources[kind].tables():
            (vertex, end), lasting = (np.multiply(p, stretch) for p in places), [np.multiply(x, stretch) for x in lengths]
            # a beam's length stands behind its direction, that of a line of sight behind its own
            first = [vertex, directions[0], *lasting[:kind == "segment"]]
            last = [end, directions[1], *lasting[kind == "segment":]]
            tables = (point,) if kind == "point" else (point, segment)
            answers.append(getattr(queries, name)(*tables, *first, *last) * stretch ** (3 if target == "point" else 2))
        return np.stack(answers)


class Source:
    """Light that a point or a segment source sends into a direction by its third and later scattering events."""

    def __init__(self, group: Group, kind: str):
        self._group, self.kind, self._tables = group, kind, None

    def __call__(self, rho, z, theta, phi, length: float | None = None) -> np.ndarray:
        """Per unit volume and unit power, (L, ...) mfp^-3 sr^-1; arguments broadcast.

        Parameters
        ----------
        rho, z : cylindrical coordinates about the source, mean free paths of the medium; light enters along +z
        theta, phi : rad, direction of travel: from +z, from the azimuth of the position
        length : of a segment, mean free paths, 0 or more; that of the table by default

        Raises
        ------
        ValueError : a length for a point source, or below 0
        MissingStage : only the other kind of source was baked
        """
        from bakery.physics.multiple import lookup

        if self.kind == "point" and length is not None:
            raise ValueError(f"length {length} of a point source, which has none; None would do")
        if length is not None and not length >= 0:
            raise ValueError(f"length {length}; 0 or more mean free paths would do")
        values = []
        for point, segment, stretch in self.tables():
            at = np.multiply(rho, stretch), np.multiply(z, stretch), theta, phi
            if self.kind == "point":
                value = lookup.point(point, *at)
            else:
                stretched = None if length is None else length * stretch
                value = lookup.segment(point, segment, *at, stretched)
            values.append(value * stretch**3)
        return np.stack(values)

    def tables(self) -> list:
        """Of each wavelength the point table, that of this source, and the mean free paths of both in one of the medium's."""
        if self._tables is None:
            from bakery.physics.multiple import lookup

            by_kind = {}
            for kind in ("point", self.kind):
                if kind not in self._group.members:
                    raise MissingStage(f"the tables of a {self.kind} source need those of a {kind} source too; bake them with "
                                       "multiple_scattering: {sources: [point, segment]}")
                by_kind[kind] = [lookup.ready(table) for table in tables_of(self._group, kind)]
            stretch = self._group["extinction"].data
            self._tables = list(zip(by_kind["point"], by_kind[self.kind], stretch, strict=True))
        return self._tables

    def __repr__(self) -> str:
        return f"{self.kind}(rho, z, theta, phi{', length=None' * (self.kind == 'segment')}) mfp^-3 sr^-1"


def tables_of(group: Group, kind: str) -> list:
    """The tables of a `multiple` group, one a wavelength, as `bakery.physics.multiple.table.Table`."""
    from bakery.physics.multiple import table

    tables = []
    for k in range(len(group["wavelength"].data)):
        group_of = group[f"{kind}/w{k}"]
        tables.append(table.from_arrays(
            {name: group_of[name].data for name in table.ARRAYS}, kind=KINDS.index(kind),
            length=float(group["length"].data[0]) if kind == "segment" else 0.0, extent=float(group["extent"].data[k]),
            k0=float(group["k0"].data[k]), error=float(group_of["error"].data[0]),
            error_with_solver=float(group_of["error_with_solver"].data[0]), worst=float(group_of["error_worst"].data[0])))
    return tables
