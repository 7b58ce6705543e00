"""What plugins of Mitsuba refuse to do only when they are asked for it, such as bumps of a texture that has no slope."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from bakery.errors import UsageError

_OF_PLUGIN = re.compile(r"\[\w+\] ")  # the class of a plugin, as Mitsuba begins its errors


@contextmanager
def told() -> Iterator[None]:
    """Raises UsageError in place of what a plugin of Mitsuba raises; other errors are mistakes of ours, and go on."""
    try:
        yield
    except RuntimeError as error:
        cause = error  # Dr.Jit's loops say that something went wrong in them, and because of what
        while cause is not None and not _OF_PLUGIN.match(str(cause)):
            cause = cause.__cause__
        if cause is None:
            raise
        raise UsageError(f"Mitsuba cannot render a surface, light or texture of this scene: {cause}") from None
