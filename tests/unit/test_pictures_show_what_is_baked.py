"""`bake plot` computes no physics: pictures look up what the bake stored."""

import sys

import pytest

import bakery
from bakery.report.figures import pictures
from bakery.store.read import read
from tests.conftest import ROOT
from tests.samples import small_asset
from tests.unit.test_imports import imports, modules

# what a picture may take of physics: look-ups in the tables of an asset, and what closed formulas say of a few of its figures
LOOKUPS = {"beam.kinds.MEASURES", "discrete.graininess", "medium.phase.phase_at", "medium.phase.phase_integral", "multiple.frame",
           "multiple.kinds.KINDS", "multiple.locate", "multiple.lookup", "surfaces.spread.profile_within"}
# files of physics whose functions may run while pictures are made
FILES = {"medium/phase.py", "multiple/frame.py", "multiple/locate.py", "multiple/lookup.py", "multiple/_products.py",
         "multiple/table.py", "multiple/tree.py", "beam/table.py", "discrete/graininess.py"}
HAZE = """\
bakery: 1
name: haze
wavelengths: [0.61, 0.465]
tolerance: 10%
medium: {albedo: [0.9, 0.5], mean_free_path: 1 mm, phase: {type: isotropic}}
multiple_scattering: {sources: [point], extent: 4, tolerance: 10%}
beam: {depth: 2, photons: 5000, tolerance: 30%}
"""
TILE = "bakery: 1\nname: tile\ntolerance: 10%\npacking: {fraction: 0.3, count: 30}\n"


def test_pictures_import_look_ups_only():
    paths = [*(ROOT / "bakery" / "stages").rglob("pictures.py"), *modules("bakery/draw"), *modules("bakery/report")]
    assert len(paths) > 8
    for path in paths:
        for name in imports(path):
            if name.startswith("bakery.physics."):
                assert name.removeprefix("bakery.physics.") in LOOKUPS, f"{path} imports {name}"


def called(root) -> set[str]:
    """Files of `bakery.physics` any of whose Python functions ran while the pictures of an asset were made and drawn."""
    from matplotlib.figure import Figure

    physics, found = str(ROOT / "bakery" / "physics") + "/", set()

    def watch(frame, event, _):
        name = frame.f_code.co_filename
        if event == "call" and name.startswith(physics):
            found.add(name.removeprefix(physics))

    list(pictures(root))  # imports run the bodies of modules
    sys.setprofile(watch)
    try:
        for picture in pictures(root):
            picture.draw(Figure())
    finally:
        sys.setprofile(None)
    return found


@pytest.fixture(scope="module")
def baked(tmp_path_factory):
    folder = tmp_path_factory.mktemp("baked")
    for name, recipe in (("haze", HAZE), ("tile", TILE)):
        (folder / f"{name}.yaml").write_text(recipe)
    return [small_asset(), *(read(bakery.bake(folder / f"{name}.yaml", folder / f"{name}.h5")) for name in ("haze", "tile"))]


@pytest.mark.slow
def test_drawing_looks_up_and_computes_nothing(baked):
    ran = set().union(*map(called, baked))
    assert ran <= FILES, f"bake plot calls {sorted(ran - FILES)}"
    assert {"medium/phase.py", "multiple/lookup.py", "beam/table.py"} <= ran  # calls are seen at all
