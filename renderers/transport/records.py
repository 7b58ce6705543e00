"""Records that lanes of a loop keep of their paths, for what waits until all paths of a pass are over.

In the loop a packet would wait for the few of its paths that walk, or follow another ray.  Each lane has space of its own, so
that records lie in the order of its paths, whatever the threads.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr

import renderers.mitsuba  # noqa: F401  before mitsuba: it finds LLVM

import mitsuba as mi  # isort: skip

_PACKET = 4  # numbers that are written together


@dataclass
class Counts:
    """How many records of each kind lanes have, by the numbers of these."""

    lane: mi.UInt32
    numbers: list


class Records:
    """What lanes have kept, of several kinds: dataclasses whose annotations name Dr.Jit's types, or `list` of `mi.Float`."""

    def __init__(self, kinds, lanes, paths):
        """
        kinds : name -> (dataclass, (records for each path, at least a lane), entries of its lists)
        lanes, paths : how many, and how many paths each follows
        """
        self._lanes, self._kinds = lanes, list(kinds)
        most = [max(int(share * paths), least) for _, (share, least), _ in kinds.values()]
        self._rows = [_Rows(record, entries, number * lanes) for (record, _, entries), number in zip(kinds.values(), most)]
        self._most = [dr.opaque(mi.UInt32, number) for number in most]
        self._ends = dr.zeros(mi.UInt32, len(most) * lanes)

    def counts(self):
        """`Counts` of lanes that have none."""
        return Counts(dr.arange(mi.UInt32, self._lanes), [dr.zeros(mi.UInt32, self._lanes) for _ in self._most])

    def has_space(self, counts, *kinds):
        """Whether lanes can keep one more of each of these kinds."""
        space = mi.Bool(True)
        for kind in map(self._kinds.index, kinds):
            space &= counts.numbers[kind] < self._most[kind]
        return space

    def add(self, counts, kind, record, active):
        """Keeps a record of a kind."""
        kind = self._kinds.index(kind)
        number = counts.numbers[kind]
        self._rows[kind].put(record, counts.lane * self._most[kind] + number, active)
        counts.numbers[kind] = number + dr.select(active, mi.UInt32(1), mi.UInt32(0))
        dr.scatter(self._ends, counts.numbers[kind], len(self._kinds) * counts.lane + kind, active)

    def kept(self, kind):
        """All records of a kind; None where there are none."""
        number = self._kinds.index(kind)
        rows, most = self._rows[number], self._most[number]
        dr.eval(rows.values, self._ends)
        index = dr.arange(mi.UInt32, rows.count)
        lane = index // most
        index = dr.compress(index - lane * most < dr.gather(mi.UInt32, self._ends, len(self._kinds) * lane + number))
        return rows.at(index) if dr.width(index) else None


class _Rows:
    """A table with a row for each record: in a column for each number they would be far apart in memory, of which writing took
    a fifth of the time of a glass of milk.

    values : of the table;  count : rows
    """

    def __init__(self, record, entries, count):
        """record : dataclass;  entries : of its lists"""
        self._record, self._entries, self.count = record, entries, count
        columns = sum(self._size(kind) for kind in record.__annotations__.values())
        self._packets = -(-columns // _PACKET)
        self.values = dr.empty(mi.Float, self._packets * _PACKET * count)

    def put(self, record, index, active):
        """Writes records into rows."""
        columns = []
        for name, kind in self._record.__annotations__.items():
            value = getattr(record, name)
            parts = value if kind == "list" else [value] if self._size(kind) == 1 else [value.x, value.y, value.z]
            whole = kind == "mi.UInt32"
            columns += [dr.reinterpret_array(mi.Float, mi.UInt32(part)) if whole else mi.Float(part) for part in parts]
        columns += [mi.Float(0)] * (self._packets * _PACKET - len(columns))
        for k in range(self._packets):
            packet = mi.Vector4f(*columns[_PACKET * k:_PACKET * (k + 1)])
            dr.scatter(self.values, packet, index * self._packets + k, active)

    def at(self, index):
        """Records of rows."""
        packets = [dr.gather(mi.Vector4f, self.values, index * self._packets + k) for k in range(self._packets)]
        columns, fields = [value for packet in packets for value in packet], {}
        for name, kind in self._record.__annotations__.items():
            parts, columns = columns[:self._size(kind)], columns[self._size(kind):]
            if kind == "list":
                fields[name] = parts
            elif kind == "mi.UInt32":
                fields[name] = dr.reinterpret_array(mi.UInt32, parts[0])
            else:
                fields[name] = parts[0] if len(parts) == 1 else getattr(mi, kind.removeprefix("mi."))(*parts)
        return self._record(**fields)

    def _size(self, kind):
        return self._entries if kind == "list" else 1 if kind in ("mi.UInt32", "mi.Float") else 3
