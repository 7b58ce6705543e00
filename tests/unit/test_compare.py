"""`compare`: what counts as a difference, and how large it is said to be."""

import math
from dataclasses import replace

import numpy as np
import pytest

from bakery.asset.compare import compare
from bakery.physics.medium.phase import cumulative
from bakery.store.hashes import seal
from bakery.store.tree import Dataset, Group, text
from bakery.store.write import write
from tests.samples import small_asset, with_member

PHASE = "medium/phase"


def changed(path: str, change) -> Group:
    root = small_asset()
    dataset = root[path]
    return with_member(root, path, Dataset(change(dataset.data), dataset.units, dataset.description, dataset.choices))


def test_same(tmp_path):
    assert compare(small_asset(), small_asset()) == []
    write(tmp_path / "a.h5", small_asset())
    assert compare(tmp_path / "a.h5", seal(small_asset())) == []


def test_what_does_not_count():
    root = with_member(small_asset(), "provenance", Group({}, {"created": "later"}))
    root = with_member(root, "recipe", text("# another comment\n", "the recipe's text"))
    medium = root["medium"]
    root = with_member(root, "medium", Group(medium.members, medium.attributes | {"stage_version": 2, "input_hash": "1" * 64}))
    root = Group(root.members, {"name": "mist", "bakery_version": "9"})
    assert compare(small_asset(), root) == []


def test_values_relative_to_themselves_and_rtol():
    other = changed(PHASE, lambda data: data * np.where(np.arange(data.shape[1]) == 7, 1.001, 1.0))
    found = compare(small_asset(), other)
    assert [(d.path, d.kind) for d in found] == [(PHASE, "value")]
    assert found[0].relative == pytest.approx(0.001 / 1.001, rel=1e-6)
    assert found[0].absolute == pytest.approx(0.001 * small_asset()[PHASE].data[:, 7].max(), rel=1e-6)
    assert "1/sr" in str(found[0]) and "2 of" in str(found[0])
    assert compare(small_asset(), other, rtol=0.001) == []
    assert compare(small_asset(), other, rtol=0.00099) != []


def test_values_that_cross_zero_are_scaled_by_the_largest():
    def tree(data):
        return Group({"s12": Dataset(np.array(data), "1/sr", "crosses zero")})

    found = compare(tree([[-1.0, 1e-12, 2.0], [10.0, 0.0, -20.0]]), tree([[-1.0, -1e-12, 2.0], [10.0, 0.2, -20.0]]))
    assert found[0].relative == pytest.approx(0.01) and "[1, 1]" in str(found[0])


def test_standard_errors():
    other = changed("optics/droplets/scattering", lambda data: data * (1 + 3e-4))
    found = compare(small_asset(), other)
    assert len(found) == 1 and found[0].sigmas == pytest.approx(3 / math.sqrt(2), rel=1e-3)
    assert "standard errors" in str(found[0])


def test_a_bias_is_no_standard_error():
    (found,) = compare(small_asset(), changed(PHASE, lambda data: data * 1.01))
    assert "medium/phase_bias" in [path for path, _ in small_asset().walk()]
    assert found.sigmas is None and "standard errors" not in str(found)


def test_not_a_number_and_infinity():
    def tree(*data):
        return Group({"x": Dataset(np.array(data), "1", "numbers")})

    assert compare(tree(np.nan, np.inf, -0.0), tree(np.nan, np.inf, 0.0)) == []
    assert compare(tree(np.nan), tree(1.0), rtol=1.0)[0].relative == math.inf
    assert compare(tree(np.inf), tree(1.0), rtol=1.0)[0].relative == math.inf
    assert compare(tree(np.inf), tree(-np.inf), rtol=1.0)[0].absolute == math.inf
    assert compare(tree(), tree()) == []


@pytest.mark.parametrize(("other", "path", "kind"), [
    (changed(PHASE, lambda data: data[:, :-1]), PHASE, "shape"),
    (changed(PHASE, lambda data: data.astype(np.float32)), PHASE, "type"),
    (changed("optics/droplets/method", lambda data: data * 0), "optics/droplets/method", "value"),
    (with_member(small_asset(), PHASE, None), PHASE, "missing"),
    (with_member(small_asset(), "optics", None), "optics", "missing"),
    (with_member(small_asset(), "medium/extra", Dataset(np.ones(1), "1", "more")), "medium/extra", "missing"),
    (with_member(small_asset(), "medium/g", Group()), "medium/g", "type"),
    (with_member(small_asset(), "medium/g", Dataset(small_asset()["medium/g"].data, "rad", "mean cosine")), "medium/g", "units"),
    (with_member(small_asset(), "medium", Group(small_asset()["medium"].members,
                                                small_asset()["medium"].attributes | {"tolerance": 0.02})),
     "medium@tolerance", "attribute"),
])
def test_kinds(other, path, kind):
    for a, b in ((small_asset(), other), (other, small_asset())):
        found = compare(a, b)
        assert [(d.path, d.kind) for d in found] == [(path, kind)]
        assert str(found[0]).startswith(f"{path}: {kind}: ")


def on_grid(root: Group, drop: slice, scale: float = 1.0) -> Group:
    """The medium on fewer angles: the same interpolant where the angles that are left out lay on its lines."""
    theta = root["medium/theta"].data
    keep = np.ones(theta.size, bool)
    keep[drop] = False
    for name in ("theta", "phase", "phase_bias", "cdf"):
        member = root[f"medium/{name}"]
        factor = scale if name == "phase" else 1.0
        root = with_member(root, f"medium/{name}", replace(member, data=factor * member.data[..., keep]))
    return root


def straight() -> Group:
    """The small asset with a phase function that is linear in cos theta from 90 degrees on."""
    root = small_asset()
    theta, phase = root["medium/theta"].data, root["medium/phase"].data
    bent = np.where(theta > np.pi / 2, phase[:, -1:] * (1 - 0.5 * np.cos(theta)), phase)
    root = with_member(root, "medium/phase", replace(root["medium/phase"], data=bent))
    root = with_member(root, "medium/phase_bias", replace(root["medium/phase_bias"], data=1e-3 * bent))
    return with_member(root, "medium/cdf", replace(root["medium/cdf"], data=cumulative(theta, bent)))


def test_other_nodes_of_sizes_are_compared_where_both_have_them():
    """Every other node left out: equal within a tolerance; without one the nodes differ, and nothing else.  A figure that differs
    at a node of both is seen."""
    root = small_asset()
    other = root
    for name in ("radius", "weight", "extinction", "scattering", "absorption", "method"):
        for path in (f"optics/droplets/{name}{ending}" for ending in ("", "_error", "_bias")):
            if path in dict(root.walk()):
                other = with_member(other, path, replace(root[path], data=root[path].data[..., ::2]))
    count = root["optics/droplets/radius"].data.size
    assert compare(root, other, rtol=1e-9) == [] and compare(other, root, rtol=1e-9) == []
    [found] = compare(root, other)
    assert (found.path, found.kind) == ("optics/droplets/radius", "grid")
    assert found.text.startswith(f"{count} nodes in A, {-(-count // 2)} in B; ")
    wrong = other["optics/droplets/extinction"].data.copy()
    wrong[0, 3] *= 1.01
    other = with_member(other, "optics/droplets/extinction", replace(other["optics/droplets/extinction"], data=wrong))
    [found] = compare(root, other, rtol=1e-3)
    assert (found.path, found.kind) == ("optics/droplets/extinction", "value") and found.relative == pytest.approx(0.01, rel=0.02)


def test_other_angles_are_compared_by_value():
    """Half of the backward angles left out of a table that is linear there: the same values at every angle."""
    root = straight()
    back = np.flatnonzero(root["medium/theta"].data > np.pi / 2)
    other = on_grid(root, back[1:-1:2])
    assert compare(root, other, rtol=1e-9) == []
    found = compare(root, other)  # without a tolerance the grids differ, and rounding shows
    assert ("medium/theta", "grid") in [(d.path, d.kind) for d in found] and not any(d.kind == "shape" for d in found)
    assert f"{root['medium/theta'].data.size} angles in A, {other['medium/theta'].data.size} in B" in str(found[0])
    # 1 % more: a difference of 1 %, in ten standard errors over the root of two, wherever one looks
    (more,) = compare(root, on_grid(root, back[1:-1:2], 1.01), rtol=1e-9)[:1]
    assert more.path == PHASE and more.relative == pytest.approx(0.01 / 1.01, rel=1e-6) and "deg: " in more.text
    assert compare(root, on_grid(root, back[1:-1:2], 1.01), rtol=0.0101) == []


def test_other_angles_between_which_values_differ():
    """As many angles, other ones: a forward peak that was cut shows at the angle where it is missing."""
    root = small_asset()
    found = compare(root, on_grid(root, slice(200, 300)), rtol=0.01)
    assert PHASE in [d.path for d in found] and all(d.kind == "value" for d in found)
    theta = root["medium/theta"].data
    shifted = np.concatenate([[0.0], np.sqrt(theta[1:-1] * theta[2:]), [np.pi]])
    same = with_member(root, "medium/theta", replace(root["medium/theta"], data=shifted))
    assert PHASE in [d.path for d in compare(root, same, rtol=0.01)]


def test_angles_that_are_no_grid_are_compared_as_they_stand():
    """Not ascending, not to pi: nothing is interpolated."""
    root = small_asset()
    for wrong in (lambda theta: theta[::-1], lambda theta: 0.9 * theta, lambda theta: theta * np.nan):
        theta = root["medium/theta"]
        other = with_member(root, "medium/theta", replace(theta, data=np.ascontiguousarray(wrong(theta.data))))
        assert ("medium/theta", "value") in [(d.path, d.kind) for d in compare(root, other, rtol=0.01)]


def test_recipe_is_named_beside_a_difference_that_counts():
    other = with_member(changed(PHASE, lambda data: data * 2), "recipe", text("another", "the recipe's text"))
    assert [d.path for d in compare(small_asset(), other)] == [PHASE, "recipe"]


def test_choices():
    method = small_asset()["optics/droplets/method"]
    swapped = Dataset(method.data, "1", method.description, ("rayleigh", "goa", "mie"))
    other = with_member(small_asset(), "optics/droplets/method", swapped)
    assert compare(small_asset(), other)[0].kind == "type"
