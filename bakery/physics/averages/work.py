"""The account of the work, and its cut into blocks that depend on the inputs alone."""

import numpy as np

from bakery.errors import StageError
from bakery.physics.medium import grid
from bakery.physics.tasks import in_turn

LONGEST = 6 * 3600.0  # seconds of work beyond which a stage is refused
BLOCK = 0.2  # seconds in a block
_GROUP = 0.1  # of a block; tasks that are shorter go to a worker together
_CALL = 5e-5  # seconds of a task besides its work


class Work:
    """Runs blocks, keeps account of the work, and refuses when it becomes endless.

    `unfinished` is set where the finest nodes over sizes leave more than their share of the tolerance.
    """

    def __init__(self, map, report):
        self.map, self.report, self.seconds, self.unfinished = map, report, 0.0, False

    def expect(self, prediction):
        if prediction.seconds > LONGEST and prediction.angles <= grid.LIMIT:
            raise StageError(
    f"about {prediction.seconds / 3600:.3g} hours of one core for {prediction.angles} angles and {prediction.spheres} spheres, "
    f"more than the {LONGEST / 3600:g} hours allowed; smaller spheres, narrower sizes, a larger tolerance or "
    "measure: integrated would do")

    def run(self, function, tasks, seconds):
        """`function(*task)` for each task, in their order; seconds: what each is expected to take.

        Of 500 wavelengths each task takes some 0.1 ms: handing them to threads one by one takes twice that.
        """
        until = np.cumsum(np.asarray(seconds) + _CALL)
        group = np.floor(until / (_GROUP * BLOCK)).astype(np.int64)
        edges = [0, *(np.flatnonzero(np.diff(group)) + 1).tolist(), len(tasks)]
        together = [(function, tasks[a:b]) for a, b in zip(edges[:-1], edges[1:]) if b > a]
        return [result for results in self.map(in_turn, together) for result in results]

    def charge(self, seconds, label):
        self.seconds += seconds
        if self.seconds > LONGEST:
            raise StageError(f"{label}: the work has grown beyond {LONGEST / 3600:g} hours of one core; smaller spheres, "
                             "a narrower size range, a larger tolerance or measure: integrated would do")


def in_one(seconds):
    """Whether so many seconds (any shape) are surely one block, whatever the rounding of sums."""
    return seconds < 0.99 * BLOCK


def cut(cost):
    """Ranges of consecutive items, each of at most `BLOCK` seconds or one item."""
    if not len(cost):
        return []
    block = np.floor(np.cumsum(cost) / BLOCK).astype(np.int64)
    edges = np.concatenate([[0], np.flatnonzero(np.diff(block)) + 1, [len(cost)]])
    return list(zip(edges[:-1].tolist(), edges[1:].tolist()))
