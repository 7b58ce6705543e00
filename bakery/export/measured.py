"""A baked surface as a measured BRDF: the tensor files that stock Mitsuba 3 (`measured`) and pbrt-v4 (`measured`) read.

What they tabulate is of `bakery.physics.surfaces.measured`; the warp of the square that the format has is uniform here.
"""

import math
import struct
from collections.abc import Mapping
from xml.sax.saxutils import quoteattr

import numpy as np

from bakery.export.mixture import identifier
from bakery.physics.surfaces.measured import Measured

_TYPES = {np.dtype(np.uint8): 1, np.dtype(np.float32): 10}  # numbers by which the file tells them


def tensor_file(table: Measured, description: str, scale: float = 1.0) -> bytes:
    """The table, all values times a scale, as a tensor file."""
    incident, _, steps = table.values.shape[:3]
    u = np.linspace(0, 1, steps)
    theta = 0.5 * math.pi * u * u
    half = np.stack([np.outer(np.cos(math.pi * (2 * u - 1)), np.sin(theta)), np.broadcast_to(np.cos(theta), (steps, steps))])
    onto = np.sin(table.theta_in)[:, None, None] * half[0] + np.cos(table.theta_in)[:, None, None] * half[1]
    # per unit of the square: what samples are drawn by
    light = table.values.mean(axis=1)
    # where all light is mirrored there is something to draw, too
    light = (light + 1e-6 * (light.max() or 1.0)) * (8 * math.pi**2 * u * np.sin(theta) * np.abs(onto))
    fields = {
        "description": np.frombuffer(description.encode("ascii", "replace"), np.uint8),
        "phi_i": np.zeros(1), "theta_i": table.theta_in, "wavelengths": table.nm,
        # the warp is uniform, and what it is multiplied by is 1: both programs divide by 4 sigma
        "ndf": np.ones((2, 2)), "sigma": np.full((2, 2), 0.25), "vndf": np.ones((1, incident, 2, 2)),
        "luminance": light[None], "spectra": scale * table.values[None], "jacobian": np.ones(1, np.uint8)}
    return packed({name: values if values.dtype == np.uint8 else values.astype(np.float32) for name, values in fields.items()})


def packed(fields: Mapping[str, np.ndarray]) -> bytes:
    """Arrays as a tensor file, version 1.0: a head, and the arrays behind it, each at a multiple of 8 bytes."""
    heads = {name: (values, 2 + len(name) + 2 + 1 + 8 + 8 * values.ndim) for name, values in fields.items()}
    at = 12 + 2 + 4 + sum(size for _, size in heads.values())
    head, body = [b"tensor_file\0" + bytes([1, 0]) + struct.pack("<I", len(fields))], []
    for name, (values, _) in heads.items():
        pad = -at % 8
        body += [b"\0" * pad, np.ascontiguousarray(values).tobytes()]
        at += pad
        head.append(struct.pack("<H", len(name)) + name.encode() + struct.pack("<HBQ", values.ndim, _TYPES[values.dtype], at)
                    + struct.pack(f"<{values.ndim}Q", *values.shape))
        at += values.nbytes
    return b"".join(head + body)


# ---- how scenes name it

BLEND = 0.2  # share of the samples that a mirror gets
# its roughness: to what a smooth one mirrors `blendbsdf` of Mitsuba 3.9.1 adds the light of the table, 29 % too much in one case
SHARP = 0.005


def mitsuba_text(name: str, file: str, index: float, both_sides: bool) -> str:
    """A scene fragment for stock Mitsuba 3 with the BSDF `name`.

    file : of the table; with a mirror, of one whose values are divided by 1 - `BLEND`
    index : of a smooth boundary that mirrors light, 1 for none
    both_sides : whether the back looks like the front
    """
    lines = [f'<string name="filename" value={quoteattr(file)}/>']
    kind = "measured"
    if index != 1:
        mirror = ['<string name="distribution" value="beckmann"/>', f'<float name="alpha" value="{SHARP}"/>',
                  f'<spectrum name="eta" value="{index!r}"/>', '<spectrum name="k" value="0"/>',
                  f'<spectrum name="specular_reflectance" value="{1 / BLEND!r}"/>']
        lines = [f'<float name="weight" value="{BLEND}"/>', *_bsdf("measured", lines), *_bsdf("roughconductor", mirror)]
        kind = "blendbsdf"
    if both_sides:
        lines, kind = _bsdf(kind, lines), "twosided"
    fragment = "\n".join(f"    {line}" for line in _bsdf(kind, lines, f" id={quoteattr(identifier(name))}"))
    return f"""<?xml version="1.0" encoding="utf-8"?>
<!-- A baked surface for stock Mitsuba 3, in its spectral variants (others have no `measured`).  Include it in a scene beside
     which {file} lies, and refer to the id:
       <include filename="..."/>   <ref id={quoteattr(identifier(name))}/> -->
<scene version="3.0.0">
{fragment}
</scene>
"""


def _bsdf(kind: str, lines: list[str], identity: str = "") -> list[str]:
    """Lines of an element around others."""
    return [f'<bsdf type="{kind}"{identity}>', *(f"    {line}" for line in lines), "</bsdf>"]


def plugin_text(name: str, asset: str, layer: int) -> str:
    """A scene fragment for bakery's plugin, which loses nothing.

    asset : file of the asset
    """
    return f"""<?xml version="1.0" encoding="utf-8"?>
<!-- A baked surface for Mitsuba 3 with bakery's plugin (`import renderers.mitsuba`), in any variant.  Include it in a scene
     beside which {asset} lies, and refer to the id:
       <include filename="..."/>   <ref id={quoteattr(identifier(name))}/> -->
<scene version="3.0.0">
    <bsdf type="bakedbsdf" id={quoteattr(identifier(name))}>
        <string name="filename" value={quoteattr(asset)}/>
        <integer name="layer" value="{layer}"/>
    </bsdf>
</scene>
"""


def pbrt_text(name: str, file: str) -> str:
    """A file for `Include` with the named material `name`; file : of the table."""
    return f"""# A baked surface for pbrt-v4.  In a scene, before its shapes, with {file} beside this file:
#   Include "..."
#   NamedMaterial "{identifier(name)}"
#   Shape "sphere" "float radius" 1
MakeNamedMaterial "{identifier(name)}"
    "string type" "measured"
    "string filename" "{file}"
"""
