"""`bake export --to mitsuba`, rendered: stock Mitsuba with the file gives the picture of the asset in `bakedphase`."""

import math
import re

import numpy as np
import pytest

from bakery.physics.medium.phase import cumulative, mean_cosine, normalised, phase_at
from bakery.store.tree import Dataset
from bakery.store.write import write
from tests.samples import small_asset, with_member

renderer = pytest.importorskip("renderers.mitsuba", exc_type=ImportError)  # before mitsuba: it finds LLVM for it

import mitsuba as mi

from renderers.mitsuba import passes

JIT = any(name.startswith("llvm") for name in renderer.variants.choose().names)
SIGMA_S, SIGMA_A = np.array([1.9, 2.4]), np.array([0.1, 0.05])
SHARE = np.array([0.5, 0.4])


@pytest.fixture(scope="module")
def hail(tmp_path_factory):
    """Half of the light in a peak of 1e-4 rad, which no table of Mitsuba's holds; a slab of 1 m is two mean free paths thick."""
    root = small_asset()
    old = root["medium/theta"].data
    theta = np.union1d(old, np.geomspace(1e-6, 0.1, 400))
    narrow = normalised(theta, np.exp(-0.5 * (theta / 1e-4) ** 2))[0]
    broad = np.array([phase_at(old, row, theta) for row in root["medium/phase"].data])
    phase = normalised(theta, SHARE[:, None] * narrow + (1 - SHARE[:, None]) * broad)[0]
    tree = with_member(root, "optics", None)
    for name in {"s11", "s12", "s33", "s34"} & tree["medium"].members.keys():
        tree = with_member(tree, f"medium/{name}", None)
    values = {"theta": theta, "phase": phase, "cdf": cumulative(theta, phase), "phase_bias": 0 * phase,
              "g": mean_cosine(theta, phase), "sigma_s": SIGMA_S, "sigma_a": SIGMA_A, "sigma_t": SIGMA_S + SIGMA_A,
              "albedo": SIGMA_S / (SIGMA_S + SIGMA_A)}
    for name, data in values.items():
        tree = with_member(tree, f"medium/{name}", Dataset(data, root[f"medium/{name}"].units, name))
    path = tmp_path_factory.mktemp("hail") / "hail.h5"
    write(path, tree)
    return path


def picture(folder, medium: str, seed: int):
    """A slab with a bright disc 10 m behind it, which fills the middle of 24 x 24 pixels: means and variances."""
    (folder / "scene.xml").write_text(f"""<scene version="3.0.0">
    {medium}
    <integrator type="volpath"> <integer name="max_depth" value="-1"/> <integer name="rr_depth" value="60"/> </integrator>
    <sensor type="perspective"> <float name="fov" value="30"/>
        <transform name="to_world"> <lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/> </transform>
        <film type="hdrfilm"> <integer name="width" value="24"/> <integer name="height" value="24"/> <rfilter type="box"/>
            <string name="pixel_format" value="luminance"/> </film>
    </sensor>
    <shape type="disk"> <transform name="to_world"> <scale value="2"/> <translate z="-10"/> </transform>
        <emitter type="area"> <spectrum name="radiance" value="1"/> </emitter> </shape>
    <shape type="cube"> <transform name="to_world"> <scale x="50" y="50" z="0.5"/> </transform>
        <bsdf type="null"/> <ref name="interior" id="hail"/> </shape>
</scene>""")
    found = passes.render([mi.load_file(str(folder / "scene.xml"))], np.ones((3, 1)), samples=1024, per_pass=256, seed=seed)
    return found.rgb[..., 0], found.variance[..., 0]


def largest_z(a, b) -> float:
    """Largest difference of two pictures in standard errors, over blocks of 8 x 8 pixels."""
    def blocks(image):
        return image.reshape(3, 8, 3, 8).mean(axis=(1, 3))

    return float(np.max(np.abs(blocks(a[0]) - blocks(b[0])) / np.sqrt((blocks(a[1]) + blocks(b[1])) / 64)))


@pytest.mark.slow
@pytest.mark.skipif(not JIT, reason="no LLVM that Dr.Jit can use")
@pytest.mark.parametrize(("i", "nm"), [(0, 610), (1, 465)])
def test_stock_mitsuba_renders_the_folded_peak(call, hail, tmp_path, i, nm):
    """9 blocks: |z| < 6 everywhere but for odds of 2e-8; the same table with the asset's own sigma_t is seen."""
    mi.set_variant("llvm_ad_mono")
    assert call("export", hail, "--to", "mitsuba", "--each-wavelength", "-o", tmp_path)[0] == 0
    exported = (tmp_path / f"hail_{nm}nm.xml").read_text()
    stock = re.search(r"<medium.*</medium>", exported, re.DOTALL)[0]
    stock = re.sub(r'<medium type="homogeneous" id="[^"]*"', '<medium type="homogeneous" id="hail"', stock)
    sigma_t, albedo = float((SIGMA_S + SIGMA_A)[i]), float((SIGMA_S / (SIGMA_S + SIGMA_A))[i])
    own = f"""<medium type="homogeneous" id="hail"> <float name="sigma_t" value="{sigma_t!r}"/>
        <float name="albedo" value="{albedo!r}"/>
        <phase type="bakedphase"> <string name="filename" value="{hail}"/> <integer name="channel" value="{i}"/> </phase>
    </medium>"""
    scale = float(re.search(r'name="scale" value="([^"]*)"', stock)[1])
    assert scale == pytest.approx(sigma_t - SHARE[i] * SIGMA_S[i], rel=0.01)
    unfolded = stock.replace(f'name="scale" value="{scale!r}"', f'name="scale" value="{sigma_t!r}"')
    assert unfolded != stock
    expected, found = picture(tmp_path, own, 1), picture(tmp_path, stock, 2)
    # the disc in the middle is seen unscattered, and by light of the peak
    assert found[0][12, 12] > math.exp(-scale)
    assert largest_z(expected, found) < 6
    assert largest_z(expected, picture(tmp_path, unfolded, 3)) > 6
