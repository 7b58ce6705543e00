"""A box of hard spheres in motion: start, growth, rest; plain steps above the kernels.

Lengths in mean final radii, masses 1, thermal speed 1 after every window.
"""

import time

import numpy as np

from bakery.physics.packing import _events, _lists, _queue

WINDOW = 20  # collisions a sphere between two settings of the clock and of the temperature
NEIGHBOURS = 12.0  # target length of a list of equal spheres
PULSE = 0.2  # seconds that one call into a kernel should take: an interrupt and `tell` get through between two


class OutOfBudget(Exception):
    """More events than the attempt may take."""


class Spheres:
    """N spheres in a periodic cuboid, at `scale` times their final radii.

    radii : (N,) final radii, descending
    cell : (3,) edges, each longer than the largest final diameter
    rng : numpy Generator, draws places and velocities
    tell : called with this object between two pieces of work; what it raises ends the run
    """

    def __init__(self, radii, cell, rng, tell):
        self.radii, self.cell, self.rng, self.tell = radii, cell, rng, tell
        self.count = radii.size
        self.scale, self.pressure = 0.0, np.nan  # the pressure is Z = PV/NkT over the last window
        self.budget = None  # events and collisions, None: no end
        self.order = np.arange(self.count)  # sphere k of the kernels is sphere order[k] of the caller
        self.room = 1.5
        self.pulse = 20_000  # events a call
        self.clock, self.tally = np.zeros(6), np.zeros(3, np.int64)
        self.volume = 4 * np.pi / 3 * np.sum(radii**3) / np.prod(cell)  # fraction at scale 1

    # -- building -----------------------------------------------------------------------------------------------------------

    def _state(self, sphere, bubble_radius):
        """Arrays for bubbles of these radii, with empty lists and grids."""
        count, cell = self.count, self.cell
        largest = bubble_radius.max()
        level = np.floor(np.log2(largest / bubble_radius) + 1e-12).astype(np.int32)
        classes, level = np.unique(level, return_inverse=True)
        reach = np.array([bubble_radius[level == k].max() for k in range(classes.size)])
        cells = np.maximum(np.floor(cell / (2 * reach[:, None])), 1.0)
        crowd = np.maximum(np.prod(cells, axis=1) / (2.0 * count + 8.0), 1.0) ** (1 / 3)  # dilute: no more cells than spheres
        cells = np.maximum(np.floor(cells / crowd[:, None]), 1.0).astype(np.int64)
        offset = np.concatenate([[0], np.cumsum(np.prod(cells, axis=1))])
        b = bubble_radius
        expected = 4 * np.pi / (3 * np.prod(cell)) * (
            count * b**3 + 3 * b**2 * b.sum() + 3 * b * np.sum(b**2) + np.sum(b**3))
        capacity = 16 * np.ceil((self.room * expected + 8.0) / 16).astype(np.int64)  # whole cache lines of 4-byte entries
        codes = np.arange(27)
        shift = (np.stack([codes // 9, codes // 3 % 3, codes % 3], axis=1) - 1.0) * cell
        bubble = _lines(count, 8)
        bubble[:, 3] = b
        index = bubble.view(np.int64)
        index[:, _lists.ROOM] = np.cumsum(capacity)
        index[:, _lists.FIRST] = index[:, _lists.LAST] = index[:, _lists.ROOM] - capacity
        entry = _lines(_queue.ENTRIES * count // 4 + 8, 8).reshape(-1, 2)
        near = _lines(int(capacity.sum()) // 16, 8).view(np.uint32).reshape(-1)
        calendar = (entry, entry.view(np.int32), np.full(_queue.BUCKETS * count + 8, -1, np.int32), np.zeros(2),
                    np.zeros(2, np.int64))
        return _lists.State(
            sphere, bubble, index, np.full(count, _events.NONE, np.int32), *calendar, near, shift, cell, level.astype(np.int32),
            reach, cells, offset[:-1].copy(), np.full(offset[-1], -1, np.int32), np.full(count, -1, np.int32), self.clock,
            self.tally)

    def place(self, fraction):
        """Random sequential addition at a volume fraction; tries lower ones where it gets stuck (few spheres)."""
        trials = 0
        while True:
            scale = (fraction / self.volume) ** (1 / 3)
            state = self._state(_lines(self.count, 8), self.radii * scale)
            standing, limit = 0, 2000 * self.count + 100_000
            while standing < self.count and limit > 0:
                uniform = self.rng.random((min(limit, 65536), 3))
                standing, used = _lists.insert(state, standing, uniform)
                limit -= used
                trials += used
                self.tell(self)
            if standing == self.count:
                break
            fraction *= 0.8
        self.scale = scale
        self.sphere = state.sphere
        self.sphere[:, 0:3] = state.bubble[:, 0:3]
        velocity = self.rng.standard_normal((self.count, 3))
        if self.count > 1:
            velocity -= velocity.mean(axis=0)
        self.sphere[:, 3:6] = velocity / np.sqrt(np.sum(velocity**2) / self._freedoms)
        self.sphere[:, 6] = self.radii

    @property
    def _freedoms(self):
        return 3.0 * max(self.count - 1, 1)

    @property
    def collisions(self):
        return int(self.tally[_events.COLLISIONS])

    @property
    def fraction(self):
        """Of now, in the midst of growth too."""
        return float(self.volume * (self.scale + self.clock[_events.RATE] * self.clock[_events.TIME]) ** 3)

    # -- motion -------------------------------------------------------------------------------------------------------------

    def _bubbles(self, end):
        """Bubble radii for work that ends at the scale `end`."""
        crowded = NEIGHBOURS / (8.0 * min(self.volume * end**3, 0.7))
        slack = max(crowded ** (1 / 3) - 1.0, 0.15) * end
        radii = self.sphere[:, 6] * end
        roof = 0.25 * self.cell.min() + 0.5 * radii.max()  # half way between the largest sphere and its own image
        return np.minimum(radii + slack, np.maximum(0.999 * roof, radii * (1 + 1e-6)))

    def _prepare(self, end):
        """Spheres in the order of space, bubbles and lists for a stretch of work."""
        permutation = _morton(self.sphere[:, 0:3], self.cell)
        self.sphere[:] = self.sphere[permutation]
        self.order = self.order[permutation]
        while True:
            self.state = self._state(self.sphere, self._bubbles(end))
            if _lists.relist_all(self.state):
                return
            self.room *= 1.5

    def _window(self, end, rate, collisions):
        """Run until the scale `end` or so many collisions; whether the end was reached."""
        clock, tally = self.clock, self.tally
        clock[_events.TIME], clock[_events.SCALE], clock[_events.RATE], clock[_events.VIRIAL] = 0.0, self.scale, rate, 0.0
        _events.predict_all(self.state)
        goal, elapsed = self.collisions + collisions, 0.0
        while True:
            stop = (end - clock[_events.SCALE]) / rate if rate > 0 else np.inf
            events, most = self.pulse, goal
            if self.budget is not None:
                events, most = min(events, self.budget[0] - int(tally.sum())), min(goal, self.budget[1])
                if events <= 0 or self.collisions >= most:
                    self.settle()
                    raise OutOfBudget
            started = time.perf_counter()
            why = _events.run(self.state, stop, most, events)
            if events == self.pulse and why == _events.PAUSED:  # no value depends on this clock, only the length of a piece
                spent = max(time.perf_counter() - started, 1e-6)
                self.pulse = int(min(max(events * PULSE / spent, 0.5 * events, 1000), 2.0 * events, 1e6))
            self.tell(self)
            if why == _events.FULL:
                elapsed += clock[_events.TIME]
                self.settle()
                self.room *= 1.5
                self._prepare(end)
                _events.predict_all(self.state)
            elif why != _events.PAUSED and (why == _events.STOPPED or self.collisions >= goal):
                break
        elapsed += clock[_events.TIME]
        temperature = self.settle() / self._freedoms  # the thermal speed is 1 from here on
        self.sphere[:, 3:6] /= np.sqrt(temperature)
        mean = (temperature - 1.0) / np.log(temperature) if abs(temperature - 1.0) > 1e-6 else 1.0
        if elapsed > 0:
            self.pressure = 1.0 + clock[_events.VIRIAL] / (3.0 * self.count * mean * elapsed)
        return why == _events.STOPPED

    def settle(self):
        """All spheres to the present time, velocities as they are."""
        twice = _events.advance(self.state)
        self.scale = float(self.clock[_events.SCALE])
        return twice

    def grow(self, fraction, rate, jammed):
        """Grow at `rate` = d(mean diameter)/dt over the thermal speed to a fraction; False where the pressure passes `jammed`."""
        end = (fraction / self.volume) ** (1 / 3)
        if end <= self.scale:
            return True
        self._prepare(end)
        while not self._window(end, 0.5 * rate, max(WINDOW * self.count, 60)):
            if self.pressure > jammed:
                return False
        self.scale = end
        return True

    def rest(self, collisions):
        """So many collisions a sphere at fixed size; the pressure is that of the second half."""
        self._prepare(self.scale)
        for _ in range(2):
            self._window(self.scale, 0.0, max(int(0.5 * collisions * self.count), 1))

    @property
    def places(self):
        """(N, 3) centres in [0, cell), in the caller's order."""
        centers = np.empty((self.count, 3))
        centers[self.order] = np.mod(self.sphere[:, 0:3], self.cell)
        centers[centers >= self.cell] = 0.0
        return centers


def _lines(rows, columns):
    """(rows, columns) zeros that begin at a cache line."""
    memory = np.zeros(columns * rows + 8)
    skip = -(memory.ctypes.data // 8) % 8
    return memory[skip:skip + columns * rows].reshape(rows, columns)


def _morton(points, cell):
    """Order along the Z curve through cells of about a sphere: neighbours in space become neighbours in memory."""
    bits = max(int(np.ceil(np.log2(max(points.shape[0], 2)) / 3)), 1)
    index = np.minimum((np.mod(points / cell, 1.0) * (1 << bits)).astype(np.int64), (1 << bits) - 1)
    code = np.zeros(points.shape[0], np.int64)
    for bit in range(bits):
        for axis in range(3):
            code |= ((index[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")
