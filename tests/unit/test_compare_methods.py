"""Which methods `bake compare` offers of a scene of several materials, or of one that has no methods."""

import pytest

from bakery.errors import UsageError
from renderers.pictures.comparison import jobs

HEAD = "bakery_scene: 2\nname: s\ncamera: {origin: [0, -2, 0] m, target: [0, 0, 0] m, fov: 40 deg}\nmaterials:\n"
MEDIUM = "- {where: everywhere, as: medium, asset: fog.h5}\n"
GRAINS = "- {where: {mesh: heap.ply}, as: grains, asset: sand.h5}\n"


@pytest.mark.parametrize(("entries", "said"), [
    (MEDIUM, "expected auto, which is paths here"),
    (MEDIUM + GRAINS, "(a medium: paths; grains: ept, vpt or ept+wide) are set beside it, such as auto:materials[1].method="),
])
def test_an_unknown_one_is_answered_with_all(tmp_path, entries, said):
    for name in ("fog.h5", "sand.h5", "heap.ply"):
        (tmp_path / name).touch()
    (tmp_path / "s.yaml").write_text(HEAD + entries)
    with pytest.raises(UsageError) as refused:
        jobs(tmp_path / "s.yaml", ["auto", "dipole"], tmp_path, {})
    assert 'found "dipole"' in str(refused.value) and said in str(refused.value)
