"""Standard streams that are closed, full or abandoned."""

import io
import os
import sys

from bakery.errors import StoreError


class _Output(io.FileIO):
    """Standard output, whose reader may go (`bake inspect … | head`): the rest goes nowhere, the exit status stays what it is."""

    def write(self, data):
        try:
            return super().write(data)
        except BrokenPipeError:
            _discard(1)
            return len(data)
        except OSError as error:
            raise StoreError(f"standard output: cannot be written: {error.strerror}") from error


def prepare() -> None:
    """Open /dev/null for what the process was started without (`bake fog.yaml 2>&-`), and tell a full standard output.

    A stream that stays closed gives its number to the next file that is opened, an asset perhaps, which then gets whatever a
    library prints.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            _discard(descriptor)
    sys.stdin = sys.stdin or io.TextIOWrapper(io.FileIO(0, "r", closefd=False))
    sys.stderr = sys.stderr or io.TextIOWrapper(io.FileIO(2, "w", closefd=False), write_through=True)
    usual = sys.stdout or sys.stderr
    sys.stdout = io.TextIOWrapper(io.BufferedWriter(_Output(1, "w", closefd=False)), usual.encoding, usual.errors,
                                  line_buffering=usual.line_buffering or usual.write_through)


def flush() -> None:
    """Write out what the streams hold.

    What a stream does not take is given up, or Python tries again at exit and puts its own status, 120, for ours.
    """
    for stream, descriptor in ((sys.stdout, 1), (sys.stderr, 2)):
        try:
            stream.flush()
        except (OSError, StoreError):
            _discard(descriptor)
        except ValueError:
            pass  # closed by us


def _discard(descriptor: int) -> None:
    null = os.open(os.devnull, os.O_RDWR)
    if null == descriptor:
        os.set_inheritable(descriptor, True)  # as the standard streams of the processes that we start
    else:
        os.dup2(null, descriptor)
        os.close(null)
