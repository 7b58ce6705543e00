"""Layers that look different from below: one surface for light from either side."""

import mitsuba as mi

from renderers.mitsuba.layer_samples import Surface
from renderers.mitsuba.rows import pick


def surface_of(layer, channel=-1, wavelength=None) -> "Surface | TwoFaces":
    """Of a `layers.Layer`, what computes its values and draws directions."""
    surface = Surface(layer, channel, wavelength)
    return surface if layer.table_below is None else TwoFaces(surface, Surface(layer.from_below, channel, wavelength))


class TwoFaces:
    """What `Surface` does; light from below meets another one, upside down."""

    def __init__(self, above: Surface, below: Surface):
        self.layer, self.flags, self.all_flags, self._above, self._below = above.layer, above.flags, above.all_flags, above, below

    def eval_pdf(self, ctx, si, wo, active=True):
        (above, density), (below, density_below) = (
            self._above.eval_pdf(ctx, si, wo, active & (si.wi.z > 0)),
            self._below.eval_pdf(ctx, _turned(si), _upside_down(wo), active & (si.wi.z < 0)))
        return above + below, density + density_below

    def sample(self, ctx, si, sample1, sample2, active=True):
        (above, weight), (below, weight_below) = (
            self._above.sample(ctx, si, sample1, sample2, active & (si.wi.z > 0)),
            self._below.sample(ctx, _turned(si), sample1, sample2, active & (si.wi.z < 0)))
        from_above = si.wi.z > 0
        below.wo = _upside_down(below.wo)
        for name in ("wo", "pdf", "sampled_type", "sampled_component"):
            setattr(above, name, pick(from_above, getattr(above, name), getattr(below, name)))
        return above, weight + weight_below


def _upside_down(direction):
    return mi.Vector3f(direction.x, direction.y, -direction.z)


def _turned(si):
    """As the other side sees it."""
    turned = mi.SurfaceInteraction3f(si)
    turned.wi = _upside_down(si.wi)
    return turned
