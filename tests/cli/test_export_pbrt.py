"""`bake export --to pbrt` in pbrt-v4 itself: a slab of the exported medium against closed forms and the asset in Mitsuba.

What the files hold is tested without pbrt, in test_export.py.
"""

import math
import os
import subprocess

import numpy as np
import pytest

from bakery.physics.medium.lobes import Lobes
from bakery.physics.medium.phase import phase_at
from bakery.store.write import write
from tests.slab import SIGMA_A, SIGMA_S, in_mitsuba, medium_of_lobes, once

NO_PBRT = "BAKERY_PBRT names no program pbrt (version 4): `make test-pbrt PBRT=…` runs this"
NM, BANDS, SIZE = (400.0, 700.0), 10, 16
CORNERS = " ".join(f"{x} {y} {z}" for x in (-10, 10) for y in (-10, 10) for z in (-0.5, 0.5))
TRIANGLES = "0 1 3  0 3 2  4 6 7  4 7 5  0 4 5  0 5 1  2 3 7  2 7 6  0 2 6  0 6 4  1 5 7  1 7 3"
SUN = 'LightSource "distant" "spectrum L" [ 300 1 900 1 ] "point3 from" [ 0 0 0 ] "point3 to" [ {:.9g} 0 {:.9g} ]'
SKY = 'LightSource "infinite" "spectrum L" [ 300 1 900 1 ]'
SCENE = """
LookAt 0 0 5  0 0 0  0 1 0
Camera "orthographic" "float screenwindow" [ -0.25 0.25 -0.25 0.25 ]
Film "spectral" "string filename" "{image}" "integer xresolution" {size} "integer yresolution" {size} "bool savefp16" false
    "integer nbuckets" {bands} "float lambdamin" {nm[0]} "float lambdamax" {nm[1]}
PixelFilter "box"
Sampler "independent" "integer pixelsamples" {samples}
Integrator "volpath" "integer maxdepth" {bounces}
WorldBegin
{light}
Include "{medium}"
AttributeBegin
    MediumInterface "fog_slab" ""
    Material "interface"
    Shape "trianglemesh" "point3 P" [ {corners} ] "integer indices" [ {triangles} ]
AttributeEnd
"""


@pytest.fixture(scope="module")
def slab(tmp_path_factory):
    """Of one lobe, which pbrt has."""
    tree, path = medium_of_lobes(Lobes((1.0,), (0.7,), (0.0,))), tmp_path_factory.mktemp("pbrt") / "slab.h5"
    write(path, tree)
    return path, tree


def in_pbrt(folder, light: str, bounces: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """(BANDS,) radiance of the slab in bands of equal width, from short wavelengths to long, and its standard error."""
    mi = pytest.importorskip("mitsuba")
    scene, image = folder / "scene.pbrt", folder / "out.exr"
    scene.write_text(SCENE.format(image=image, size=SIZE, bands=BANDS, nm=NM, samples=samples, bounces=bounces, light=light,
                                  medium=folder / "slab.pbrt", corners=CORNERS, triangles=TRIANGLES))
    subprocess.run([os.environ["BAKERY_PBRT"], "--quiet", str(scene)], check=True, stdout=subprocess.DEVNULL)
    pixels = np.array(mi.Bitmap(str(image))).reshape(SIZE**2, 3 + BANDS)[:, 3:]  # RGB, then bands
    return pixels.mean(axis=0), pixels.std(axis=0, ddof=1) / SIZE


def within_bands(values):
    """(BANDS,) means of a function of wavelength (nm)."""
    edges = np.linspace(*NM, BANDS + 1)
    inside = edges[:-1, None] + (edges[1] - edges[0]) * (np.arange(20) + 0.5) / 20
    return values(inside.ravel()).reshape(BANDS, 20).mean(axis=1)


@pytest.mark.slow
def test_pbrt_renders_it(call, slab, tmp_path):
    """Scattered once at eight angles and unscattered against closed forms; scattered often against the asset in Mitsuba.

    Bounds are 6 standard errors (of 96 numbers: a false alarm once in 5 million, pixels taken as independent) and what a table of
    400 angles differs from its lobe by, 0.5 %.
    """
    if not os.environ.get("BAKERY_PBRT"):
        pytest.skip(NO_PBRT)
    path, tree = slab
    assert call("export", path, "--to", "pbrt", "-o", tmp_path)[0] == 0
    um, theta, phase = tree["wavelength"].data, tree["medium/theta"].data, tree["medium/phase"].data[0]
    order = np.argsort(um)

    def sigma(nm):
        """sigma_s, sigma_t (1/m) as the asset has them: linear, constant beyond its wavelengths."""
        s, a = (np.interp(nm, 1e3 * um[order], values[order]) for values in (SIGMA_S, SIGMA_A))
        return s, s + a

    for degrees in (0.5, 5, 20, 40, 70, 110, 150, 180):
        angle = math.radians(degrees)
        found, error = in_pbrt(tmp_path, SUN.format(math.sin(angle), math.cos(angle)), 1, 256)
        expected = within_bands(lambda nm, angle=angle: phase_at(theta, phase, angle) * once(angle, *sigma(nm)))
        assert np.all(np.abs(found - expected) < 6 * error + 0.005 * expected), degrees
    found, error = in_pbrt(tmp_path, SKY, 0, 1024)
    assert np.all(np.abs(found - within_bands(lambda nm: np.exp(-sigma(nm)[1]))) < 6 * error)
    compared = [2, 5, 8]  # bands that Mitsuba has as red, green and blue
    centres = NM[0] + (NM[1] - NM[0]) / BANDS * (np.array(compared) + 0.5)
    for degrees in (30, 140):
        angle = math.radians(degrees)
        found, error = in_pbrt(tmp_path, SUN.format(math.sin(angle), math.cos(angle)), 1000, 4096)
        expected, noise = in_mitsuba(path, *sigma(centres), angle)
        error = np.hypot(noise, error[compared])
        assert np.all(np.abs(found[compared] - expected) < 6 * error + 0.005 * expected), degrees
        assert np.all(error < 0.025 * expected)
        # much of it was scattered more than once
        assert np.all(expected > 1.2 * phase_at(theta, phase, angle) * once(angle, *sigma(centres)))
