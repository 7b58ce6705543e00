"""A material for Cycles in Blender, as a Python script that makes it.

Cycles takes sums of Henyey-Greenstein and Draine lobes, with coefficients in colour.  Of lobes with colours of their own it
takes the shares of all channels together (measured in Blender 5.0): one mixture stands for all wavelengths.
"""

from __future__ import annotations

import numpy as np

from bakery.export.mixture import Mixture, identifier, source
from bakery.physics.medium.lobe_fits import hg_draine
from bakery.store.tree import Group

STEEPEST = 0.999  # |g|: Cycles takes larger ones for this one (kernel/closure/volume_henyey_greenstein.h, volume_draine.h)


def cycles_medium(root: Group, name: str, within: float = 0.0) -> Mixture:
    """An asset's medium with the mean cosine kept and, beside it, the least misdirected light of HG + Draine.

    Parameters
    ----------
    as of `bakery.export.mixture.source`

    Raises
    ------
    AssetError : there is no medium
    """
    found = source(root, name, within)
    return found.mixture(hg_draine(found.medium.theta, found.mean, STEEPEST))


def blender_text(name: str, medium: Mixture, bands) -> str:
    """A script for Blender 5 that makes a material of the medium.

    Parameters
    ----------
    name : of the medium and of the material
    medium : of `cycles_medium`
    bands : (3, L) 1, red, green and blue as means over the wavelengths; rows add up to 1
    """
    sigma_s = bands @ medium.sigma_s
    lobes = "".join(f"    ({_colour(weight * sigma_s)}, {g:.9g}, {alpha:.9g}),\n"
                    for weight, g, alpha in zip(medium.lobes.weight, medium.lobes.g, medium.lobes.alpha, strict=True))
    remarks, plain = "\n".join(f"# {line}" for line in medium.remarks()), identifier(name)
    return f'''# A baked medium for Cycles in Blender 5.
# Run it in Blender's text editor, or as
#   blender scene.blend --python ...
# It makes the material "{plain}", or makes it anew, and changes nothing else.  It is for closed meshes and has no surface.
# Light that is scattered more than once needs Render > Light Paths > Max Bounces > Volume, which is 0 at first.
{remarks}
import bpy

NAME = "{plain}"
# 1/m, linear Rec. 709
ABSORPTION = {_colour(bands @ medium.sigma_a)}
# scattering in 1/m, linear Rec. 709; g; alpha of Draine's lobe, 0: Henyey and Greenstein's
LOBES = [
{lobes}]

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
'''


def _colour(values) -> str:
    return "(" + ", ".join(f"{value:.9g}" for value in np.asarray(values).tolist()) + ")"
