"""A material for Cycles in Blender, as a Python script that makes it.

Cycles takes sums of Henyey-Greenstein and Draine lobes, with coefficients in colour.  Of lobes with colours of their own it
takes the shares of all channels together (measured in Blender 5.0): one mixture stands for all wavelengths.
"""

import math

import numpy as np

from bakery.export.mixture import Mixture, identifier, source
from bakery.physics.medium.lobe_fits import hg_draine
from bakery.store.tree import Group

_MOST = 1024  # bounces that Cycles takes
_SURFACE = '''
glass = tree.nodes.new("ShaderNodeBsdfGlass")
glass.location = 250 * len(LOBES) - 250, 300
glass.distribution = "GGX"
glass.inputs["Color"].default_value = 1, 1, 1, 1
glass.inputs["IOR"].default_value, glass.inputs["Roughness"].default_value = INDEX, ROUGHNESS
tree.links.new(glass.outputs[0], output.inputs["Surface"])
'''
STEEPEST = 0.999  # |g|: Cycles takes larger ones for this one (kernel/closure/volume_henyey_greenstein.h, volume_draine.h)


def cycles_medium(root: Group, name: str, within: float = 0.0) -> Mixture:
    """An asset's medium with the mean cosine kept and, beside it, the least misdirected light of HG + Draine.

    Arguments and errors as of `bakery.export.mixture.source`.
    """
    lobe = source(root, name, within)
    return lobe.mixture(hg_draine(lobe.medium.theta, lobe.mean, STEEPEST))


_SCRIPT = '''# A baked medium for Cycles in Blender 5.
# Run it in Blender's text editor, or as
#   blender scene.blend --python ...
# It makes the material "{plain}", or makes it anew, and marks it as an asset: the asset browser shows it in
# Current File, and in other files once this one is saved in the folder of an asset library.  It is for closed meshes, and has
# {kind}.  In Cycles it raises Render > Light Paths > Max Bounces > Volume and Total to BOUNCES where they are less:
# at first no light is scattered more than once.  Nothing else changes; Clamping > Indirect, 10 at first, takes light away.
{remarks}
import bpy

NAME = "{plain}"
# 1/m, linear Rec. 709
ABSORPTION = {absorption}
# scattering in 1/m, linear Rec. 709; g; alpha of Draine's lobe, 0: Henyey and Greenstein's
LOBES = [
{lobes}]
BOUNCES = {bounces}  # after which 1 % of the light is left, at most 1024
INDEX, ROUGHNESS = {index:.9g}, {roughness:.9g}  # roughness as Blender has it, the root of alpha

if bpy.app.version < (5, 0, 0):
    raise RuntimeError(f"{{NAME}}: this script is for Blender 5.0 and later, this is {{bpy.app.version_string}}")
metres = bpy.context.scene.unit_settings.scale_length  # of one unit of the scene
material = bpy.data.materials.get(NAME) or bpy.data.materials.new(NAME)
tree = material.node_tree
tree.nodes.clear()
total = None
for i, (scattering, g, alpha) in enumerate(LOBES):
    lobe = tree.nodes.new("ShaderNodeVolumeCoefficients")
    lobe.location = 0, -400 * i
    lobe.phase = "DRAINE" if alpha else "HENYEY_GREENSTEIN"
    lobe.inputs["Absorption Coefficients"].default_value = [metres * x if i == 0 else 0.0 for x in ABSORPTION]
    lobe.inputs["Scatter Coefficients"].default_value = [metres * x for x in scattering]
    lobe.inputs["Anisotropy"].default_value = g
    if alpha:  # Blender hides the input from the other phase functions
        lobe.inputs["Alpha"].default_value = alpha
    if total is None:
        total = lobe
        continue
    both = tree.nodes.new("ShaderNodeAddShader")
    both.location = 250 * i, 0
    tree.links.new(total.outputs[0], both.inputs[0])
    tree.links.new(lobe.outputs[0], both.inputs[1])
    total = both
output = tree.nodes.new("ShaderNodeOutputMaterial")
output.location = 250 * len(LOBES), 0
tree.links.new(total.outputs[0], output.inputs["Volume"])
{glass}
if not material.asset_data:
    material.asset_mark()
material.asset_data.description = "Baked medium, {kind}"
material.asset_data.tags.new("bakery", skip_if_exists=True)
cycles = getattr(bpy.context.scene, "cycles", None)
if cycles is not None:  # the add-on may be off
    cycles.volume_bounces, cycles.max_bounces = max(cycles.volume_bounces, BOUNCES), max(cycles.max_bounces, BOUNCES)
'''


def blender_text(name: str, medium: Mixture, bands, index=None, roughness=0.0) -> str:
    """A script for Blender 5 that makes a material of the medium.

    name : of the medium and of the material
    bands : (3, L) 1, red, green and blue as means over the wavelengths; rows add up to 1
    index : refractive index of the surface over that of air; None, or 1: there is no surface
    roughness : alpha of the surface (GGX)
    """
    sigma_s = bands @ medium.sigma_s
    lobes = "".join(f"    ({_colour(weight * sigma_s)}, {g:.9g}, {alpha:.9g}),\n"
                    for weight, g, alpha in zip(medium.lobes.weight, medium.lobes.g, medium.lobes.alpha, strict=True))
    glass = "" if index in (None, 1.0) else _SURFACE
    kind = "no surface" if not glass else f"a surface of index {index:g}"
    remarks, plain = "\n".join(f"# {line}" for line in medium.remarks()), identifier(name)
    return _SCRIPT.format(plain=plain, kind=kind, remarks=remarks, absorption=_colour(bands @ medium.sigma_a), lobes=lobes,
                          bounces=_bounces(sigma_s, bands @ medium.sigma_a), index=index or 1.0, roughness=math.sqrt(roughness),
                          glass=glass)


def _bounces(sigma_s, sigma_a) -> int:
    """Scatterings after which 1 % of the light is left where most is, up to what Cycles takes."""
    albedo = float(np.max(sigma_s / np.maximum(sigma_s + sigma_a, 1e-300)))
    if albedo <= 0:
        return 0
    return _MOST if albedo >= 1 else min(_MOST, math.ceil(math.log(0.01) / math.log(albedo)))


def _colour(values) -> str:
    return "(" + ", ".join(f"{value:.9g}" for value in np.asarray(values).tolist()) + ")"


_OPAQUE = '''# A baked surface for Cycles in Blender 5.
# Run it in Blender's text editor, or as
#   blender scene.blend --python ...
# It makes the material "{plain}", or makes it anew, and marks it as an asset.
{remarks}
import bpy

NAME = "{plain}"
INPUTS = {inputs}
SPREAD = False  # whether light comes out elsewhere than it went in
RADIUS = {radius}  # m, of "Subsurface Radius"
{look_up}
if bpy.app.version < (5, 0, 0):
    raise RuntimeError(f"{{NAME}}: this script is for Blender 5.0 and later, this is {{bpy.app.version_string}}")
material = bpy.data.materials.get(NAME) or bpy.data.materials.new(NAME)
tree = material.node_tree
tree.nodes.clear()
surface = tree.nodes.new("ShaderNodeBsdfPrincipled")
for key, value in INPUTS.items():
    surface.inputs[key].default_value = value
if SPREAD and RADIUS:
    surface.subsurface_method = "BURLEY"
    metres = bpy.context.scene.unit_settings.scale_length  # of one unit of the scene
    surface.inputs["Subsurface Weight"].default_value, surface.inputs["Subsurface Scale"].default_value = 1.0, 1.0
    surface.inputs["Subsurface Radius"].default_value = [x / metres for x in RADIUS]
output = tree.nodes.new("ShaderNodeOutputMaterial")
output.location = 600, 0
tree.links.new(surface.outputs[0], output.inputs["Surface"])
{curves}if not material.asset_data:
    material.asset_mark()
material.asset_data.description = "Baked surface"
material.asset_data.tags.new("bakery", skip_if_exists=True)
'''


_LOOK_UP = '''LOOK_UP = True  # whether colours change with the angle of view, where light does not spread
# of the base and of a glossy lobe, by 1 - cosine
FACING = {facing}
BASE = [
{base}]
LOBE = [
{lobe}]
LOBE_ROUGHNESS = {roughness:.9g}  # as Blender has it, the root of alpha
'''
_CURVES = '''if LOOK_UP and not SPREAD:
    view = tree.nodes.new("ShaderNodeLayerWeight")
    view.location = -600, 0
    view.inputs["Blend"].default_value = 0.5
    glossy = tree.nodes.new("ShaderNodeBsdfAnisotropic")  # "Glossy BSDF"
    glossy.location = 0, 300
    glossy.distribution = "GGX"
    glossy.inputs["Roughness"].default_value = LOBE_ROUGHNESS
    surface.inputs["Diffuse Roughness"].default_value = 0.0
    for y, colours, socket in ((0, BASE, surface.inputs["Base Color"]), (300, LOBE, glossy.inputs["Color"])):
        ramp = tree.nodes.new("ShaderNodeValToRGB")
        ramp.location = -300, y
        stops = ramp.color_ramp.elements  # 0 and 1 are there
        for x in FACING[1:-1]:
            stops.new(x)
        for stop, colour in zip(stops, colours):
            stop.color = (*colour, 1.0)
        tree.links.new(view.outputs["Facing"], ramp.inputs[0])
        tree.links.new(ramp.outputs["Color"], socket)
    both = tree.nodes.new("ShaderNodeAddShader")
    both.location = 300, 0
    tree.links.new(surface.outputs[0], both.inputs[0])
    tree.links.new(glossy.outputs[0], both.inputs[1])
    tree.links.new(both.outputs[0], output.inputs["Surface"])
'''


def surface_text(name: str, fit, remarks, widths=None, curves=None) -> str:
    """A script for Blender 5 that makes a material of a baked surface.

    curves : `bakery.physics.surfaces.by_view.ByView` of the same; None: one colour at all angles
    widths : (3,) m, d of Burley and Christensen's profile; None: light does not spread
    """
    # Cycles takes d = radius / (4 pi (1.9 - A + 3.5 (A - 0.8)^2)), A the base colour (kernel/closure/bssrdf.h)
    radius = "None" if widths is None else _colour(4 * math.pi * widths * (1.9 - fit.colour + 3.5 * (fit.colour - 0.8) ** 2))
    # Blender's roughness is the root of alpha; "Specular IOR Level" 0.5 is Fresnel's reflection at "IOR", 0 none
    inputs = {"Base Color": (*(round(float(x), 9) for x in fit.colour), 1.0), "Diffuse Roughness": fit.diffuse_roughness,
              "Metallic": 0.0, "IOR": fit.index if fit.index != 1 else 1.5, "Roughness": math.sqrt(fit.roughness),
              "Specular IOR Level": 0.5 if fit.index != 1 else 0.0}
    remarks = "\n".join(f"# {line}" for line in remarks)
    look_up = ""
    if curves is not None:
        base, lobe = ("".join(f"    {_colour(colour)},\n" for colour in rows.T[::-1]) for rows in (curves.base, curves.lobe))
        look_up = _LOOK_UP.format(facing=_colour(1 - curves.cosine[::-1]), base=base, lobe=lobe,
                                  roughness=math.sqrt(curves.alpha))
    return _OPAQUE.format(plain=identifier(name), inputs=repr(inputs), radius=radius, remarks=remarks, look_up=look_up,
                          curves=_CURVES if look_up else "")
