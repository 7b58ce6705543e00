"""The page of `bake render --live`: its server, its address, a browser where somebody sits in front of one."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from bakery.system.terminal import remark


@contextmanager
def shown(scene, source: str, port: int, browser: bool) -> Iterator[Callable]:
    """What renders a scene as its renderer does, and shows it on a page meanwhile: a function of (scene, output, **options).

    source : its file, as the user names it
    port : of the page; 0: a free one
    browser : open one, where there is a screen and somebody at the terminal

    Raises UsageError where its renderer goes by no passes.

    Where the port cannot be had, or no browser opens, a line says so and the render goes on.
    """
    from bakery.report import live, served
    from renderers.pictures.live import Watch, refuse_other, render

    refuse_other(scene)
    watch, server = Watch(), None
    try:
        server = served.Server(live.page(scene.values.name, source), watch, port)
        remark(f"live: {server.address}")
    except (OSError, OverflowError) as fault:
        wanted = f"port {port}" if port else "a port"
        why = getattr(fault, "strerror", None) or fault
        remark(f"--live: {wanted} of {served.HOST} is not available ({why}); the render continues without its page")
    if server and browser and _somebody_looks():
        _open(server.address)
    try:
        yield lambda path, output, **options: render(path, output, watch, **options)
    finally:
        if server:
            server.close()


def _somebody_looks() -> bool:
    """Whether a browser has a screen to open on, and the command a terminal."""
    try:
        terminal = sys.stderr is not None and sys.stderr.isatty()
    except ValueError:
        return False  # closed
    screen = sys.platform in ("darwin", "win32") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))
    return terminal and screen


def _open(address: str) -> None:
    import webbrowser

    try:
        opened = webbrowser.open(address)
    except (webbrowser.Error, OSError):
        opened = False
    if not opened:
        remark("--live: no browser could be opened; open the address above in one on this machine")
