"""Threads of Dr.Jit: one where few rays come next."""

import pytest

from renderers import threads
from renderers.transport.paths import follow

dr = pytest.importorskip("drjit")


class Waiting:
    """So many paths."""

    def __init__(self, count):
        self.count = count


def test_few_paths_have_one_thread_and_all_are_given_back():
    before, counts = dr.thread_count(), []
    dr.set_thread_count(3)
    try:
        def step(paths):
            counts.append((paths.count, dr.thread_count()))
            if paths.count == 1:
                raise KeyboardInterrupt
            return Waiting(paths.count // 2)

        with pytest.raises(KeyboardInterrupt):
            follow(0, 1, lambda first, last: Waiting(4 * threads._FEW), step)
        assert dr.thread_count() == 3
    finally:
        dr.set_thread_count(before)
    assert counts[0] == (4 * threads._FEW, 3) and counts[-1] == (1, 1)
    assert all(number == (1 if count < threads._FEW else 3) for count, number in counts)
