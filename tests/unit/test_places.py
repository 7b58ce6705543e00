"""Which of the materials that fill one mesh is the innermost."""

from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from renderers.mitsuba import variants
from renderers.transport.places import BLIND, TURNS, Places, box, mesh


@pytest.mark.parametrize("edge, sign", [(0.1, 1), (0.7, -1)])
def test_of_equal_regions_the_body_is_the_innermost(edge, sign):
    """Mitsuba rounds the body's vertices, here outward or inward: its volume is not that of the medium's mesh, or box."""
    variants.activate("rgb")
    from renderers.transport import regions, scene

    cube = trimesh.creation.box()
    exact, faces = 2 * edge * np.asarray(cube.vertices), np.asarray(cube.faces)
    rounded = exact.astype(np.float32).astype(float)
    assert sign * (np.abs(rounded).max() - np.abs(exact).max()) > 0
    corners = exact.min(axis=0), exact.max(axis=0)
    for bounds in (BLIND, TURNS):
        rank = Places([mesh(exact, faces), mesh(rounded, faces, bounds), box(*corners)]).rank
        assert rank[1] < min(rank[0], rank[2])
    body = SimpleNamespace(vertices=rounded, faces=faces)
    for region in (regions.Mesh(exact, faces), regions.Box(*corners)):
        assert scene._place(body) < scene._place(regions.Medium(region, None))
