"""Surfaces of OpenPBR around a medium, as MaterialX and as USD.

OpenPBR states its media in two ways.  By transmission: sigma_t = -ln(transmission_color) / transmission_depth and sigma_s =
transmission_scatter / transmission_depth, in colour and to the digits of single precision.  By subsurface scattering: the mean
free path and the colour that a thick body has, which renderers turn into an albedo.  Both have one Henyey-Greenstein lobe.

Plain text: neither format needs its library to be written.  The tests read the files with both.
"""

import numpy as np

from bakery.export.mixture import identifier
from bakery.export.one_lobe import OneLobe

Value = float | tuple[float, ...]


def surfaces(lobe: OneLobe, bands) -> dict[str, dict[str, Value]]:
    """Inputs of `open_pbr_surface` by kind of surface, `volume` and `subsurface`; three numbers are a colour.

    bands : (3, L) 1, red, green and blue as means over the wavelengths; rows add up to 1

    Lengths are in metres.  The index of refraction is 1, which no light is reflected at: the asset's medium has no surface.
    """
    sigma_t, sigma_s = bands @ lobe.sigma_t, bands @ lobe.sigma_s
    return {"volume": _volume(sigma_t, sigma_s, lobe.g), "subsurface": _subsurface(sigma_t, sigma_s, lobe.g)}


def observed_colour(albedo, g):
    """What a half-space reflects of diffuse light, by its albedo and mean cosine, without a change of index: (...,) 1.

    Its inverse, s = 4.09712 + 4.20863 C - sqrt(9.59217 + 41.6808 C + 17.7126 C^2) and albedo = (1 - s^2) / (1 - g s^2), is
    what OpenPBR asks of renderers.  Source: van de Hulst, Multiple Light Scattering (1980), in the form of Kulla and Conty,
    Revisiting Physically Based Shading at Imageworks (SIGGRAPH 2017 course).
    """
    s = np.sqrt((1 - albedo) / (1 - g * albedo))
    return (1 - s) * (1 - 0.139 * s) / (1 + 1.17 * s)


def _volume(sigma_t, sigma_s, g) -> dict[str, Value]:
    # the shortest mean free path keeps all inputs between 0 and 1 and the digits of transmission_color
    depth = 1 / float(sigma_t.max()) if sigma_t.any() else 1.0
    return {"specular_roughness": 0.0, "specular_ior": 1.0, "transmission_weight": 1.0,
            "transmission_color": _colour(np.exp(-sigma_t * depth)), "transmission_depth": depth,
            "transmission_scatter": _colour(sigma_s * depth), "transmission_scatter_anisotropy": g}


def _subsurface(sigma_t, sigma_s, g) -> dict[str, Value]:
    albedo = np.divide(sigma_s, sigma_t, out=np.zeros_like(sigma_t), where=sigma_t > 0)
    # a channel without collisions gets a path a million times as long as the shortest
    path = 1 / np.maximum(sigma_t, 1e-6 * float(sigma_t.max()) or 1.0)
    radius = float(path.max())
    return {"specular_ior": 1.0, "subsurface_weight": 1.0, "subsurface_color": _colour(observed_colour(np.clip(albedo, 0, 1), g)),
            "subsurface_radius": radius, "subsurface_radius_scale": _colour(path / radius), "subsurface_scatter_anisotropy": g}


def _colour(values) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def materialx_text(name: str, lobes: dict[str, dict[str, Value]], remarks: list[str]) -> str:
    """A MaterialX 1.39 document with one material for each kind of surface.

    name : of the medium; materials are NAME_volume and NAME_subsurface
    """
    plain = identifier(name)
    nodes = "".join(f"""  <open_pbr_surface name="{plain}_{kind}_surface" type="surfaceshader">
{"".join(_mtlx_input(key, value) for key, value in inputs.items())}  </open_pbr_surface>
  <surfacematerial name="{plain}_{kind}" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="{plain}_{kind}_surface" />
  </surfacematerial>
""" for kind, inputs in lobes.items())
    return f"""<?xml version="1.0" encoding="utf-8"?>
<!-- A baked medium in surfaces of OpenPBR.
{_about(f"{plain}_", remarks)} -->
<materialx version="1.39" colorspace="lin_rec709">
{nodes}</materialx>
"""


def baked_surface(fit) -> dict[str, Value]:
    """Inputs of `open_pbr_surface` of a baked surface; fit : `bakery.physics.surfaces.principled.Principled`."""
    # OpenPBR's roughness is the root of alpha
    boundary = {"specular_weight": 1.0, "specular_ior": fit.index, "specular_roughness": float(np.sqrt(fit.roughness))} \
        if fit.index != 1 else {"specular_weight": 0.0}
    return {"base_weight": 1.0, "base_color": _colour(fit.colour), "base_diffuse_roughness": fit.diffuse_roughness} | boundary


def materialx_surface(name: str, inputs: dict[str, Value], remarks: list[str]) -> str:
    """A MaterialX 1.39 document with the material `name` of a baked surface; inputs : of `baked_surface`."""
    plain, about = identifier(name), "\n".join(f"     {line}" for line in remarks)
    return f"""<?xml version="1.0" encoding="utf-8"?>
<!-- A baked surface in OpenPBR.  Colours are linear sRGB.
{about} -->
<materialx version="1.39" colorspace="lin_rec709">
  <open_pbr_surface name="{plain}_shader" type="surfaceshader">
{"".join(_mtlx_input(key, value) for key, value in inputs.items())}  </open_pbr_surface>
  <surfacematerial name="{plain}" type="material">
    <input name="surfaceshader" type="surfaceshader" nodename="{plain}_shader" />
  </surfacematerial>
</materialx>
"""


def usd_text(name: str, lobes: dict[str, dict[str, Value]], remarks: list[str]) -> str:
    """A USD layer (text) with one `Material` for each kind of surface under /NAME, whose shaders are MaterialX's.

    as of `materialx_text`
    """
    plain = identifier(name)
    materials = "\n".join(f"""    def Material "{kind}" (
        prepend apiSchemas = ["MaterialXConfigAPI"]
    )
    {{
        uniform string config:mtlx:version = "1.39"
        token outputs:mtlx:surface.connect = </{plain}/{kind}/surface.outputs:out>

        def Shader "surface"
        {{
            uniform token info:id = "ND_open_pbr_surface_surfaceshader"
{"".join(_usd_input(key, value) for key, value in inputs.items())}            token outputs:out
        }}
    }}
""" for kind, inputs in lobes.items())
    return f"""#usda 1.0
(
    defaultPrim = "{plain}"
    doc = \"\"\"A baked medium in surfaces of OpenPBR.
{_about(f"/{plain}/", remarks)}\"\"\"
    metersPerUnit = 1
    upAxis = "Y"
)

def Scope "{plain}"
{{
{materials}}}
"""


def _about(prefix: str, remarks: list[str]) -> str:
    comment = "\n".join(f"     {line}" for line in remarks)
    return f"""     {prefix}volume: for bodies that one can see into; coefficients by transmission_color, _depth and _scatter.
     {prefix}subsurface: for thick bodies; mean free path and colour of a half-space.
     Colours are linear sRGB.  Lengths are in metres: in a scene of another unit divide transmission_depth and
     subsurface_radius by its length in metres.  specular_ior is 1: the medium has no surface of its own.
{comment}"""


def _mtlx_input(key: str, value: Value) -> str:
    kind = "color3" if isinstance(value, tuple) else "float"
    return f'    <input name="{key}" type="{kind}" value="{_numbers(value)}" />\n'


def _usd_input(key: str, value: Value) -> str:
    kind, text = ("color3f", f"({_numbers(value)})") if isinstance(value, tuple) else ("float", _numbers(value))
    return f"            {kind} inputs:{key} = {text}\n"


def _numbers(value: Value) -> str:
    return ", ".join(f"{x:.9g}" for x in (value if isinstance(value, tuple) else (value,)))
