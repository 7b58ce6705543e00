"""Scenes of tests, rendered as a user calls it: report and layers, refusals, and the toy renderer in the place of the others."""

import gc
import json

import numpy as np

from renderers import scene
from tests.exr import layers

HAZE = """\
bakery_scene: 2
name: haze
asset: milk.h5
camera: {origin: [0, -2, 1] m, target: [0, 0, 1] m, fov: 40 deg}
toy: {sun: [1, 2, -1]}
"""


def rendered(call, place, name, *settings, options=()):
    """Report and layers of a render of `s.yaml` that works."""
    status, out, err = call("render", place / "s.yaml", "-o", place / f"{name}.png", "--json", *options,
                            *(part for setting in settings for part in ("--set", setting)))
    assert status in (0, 3), err
    report = json.loads(out)
    assert (status == 3) == bool(report["missed"]), err
    return report, layers(place / f"{name}.exr")


def picture(found, name=""):
    """(H, W, 3) of a layer."""
    return np.stack([found[f"{name}{c}"] for c in "RGB"], axis=-1).astype(float)


def refused(call, place, said, *settings, source="s.yaml"):
    """One message, and no picture."""
    status, out, err = call("render", place / source, "-o", place / "x.png",
                            *(part for setting in settings for part in ("--set", setting)))
    assert status and not out and said in err and "Traceback" not in err and not (place / "x.png").exists(), err


def undisturbed_by_scenes(kernels, *arguments):
    """What `kernels` gives, hashes of kernels of wavefronts that are to have the same ones.

    Dr.Jit's kernels hold the surfaces of all scenes of a process, and a scene of another test may go at any moment: where hashes
    differ, all is done again, three times at most.  Kernels that depend on the wavefront differ each time.
    """
    from renderers.mitsuba.recording import undisturbed

    for _ in range(3):
        gc.collect()
        with undisturbed():
            first, *others = hashes = kernels(*arguments)
        if all(other == first for other in others):
            break
    return hashes


def hazy(call, milk, monkeypatch, render, **state):
    """The folder of a scene that `render` renders in place of the toy, and goes on with; `state` becomes its attributes."""
    monkeypatch.setitem(scene.RENDERERS, "toy", "tests.toy_renderer")
    monkeypatch.setattr("tests.toy_renderer.scene.RESUMES", True)
    monkeypatch.setattr("tests.toy_renderer.scene.UNUSED", {})
    monkeypatch.setattr("tests.toy_renderer.render", render)
    monkeypatch.setattr("bakery.report.comparison.drawing", lambda times: "<figure>drawn</figure>")
    for name, value in ({"asked": [], "interrupt": None} | state).items():
        monkeypatch.setattr(render, name, value, raising=False)
    (milk.parent / "haze.yaml").write_text(HAZE + "description: A haze & a <sun>\n")
    assert call(milk, "-o", milk.parent / "milk.h5", "--quiet")[0] == 0
    return milk.parent


def refused_unrendered(call, place, command, wrong):
    """Each call of a command, words of one line, is refused before anything is rendered or written."""
    (place / "notes.html").write_text("what I saw")
    before = set(place.iterdir())
    for words, said in wrong:
        status, out, err = call(command, *words.split())
        assert status == 2 and not out and said in err, (words, err)
    assert set(place.iterdir()) == before
