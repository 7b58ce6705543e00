"""Fog in somebody's scene of Mitsuba: as thick as shows in a picture of that scene."""

import math
import os
import re
from pathlib import Path

import numpy as np

from bakery.recipe import load
from bakery.recipe.starting import Start
from bakery.run import draft
from bakery.run.cache import Cache
from bakery.starting.meshes import UNITS, length, written

# Koschmieder 1924: a black thing before the sky keeps 2 % of its contrast at the visibility, -ln 0.02 optical depths away
CONTRAST = -math.log(0.02)
THICKEST, THINNEST = 10.0, 20e3  # m, visibility in dense fog, and in haze
_DENSITY = re.compile(r"^(\s*)number_density:.*$", re.MULTILINE)


def filled(material: Start, mitsuba: Path, folder: Path, name: str, view, unit: str | None = None):
    """A recipe and a scene of a material in all of a Mitsuba scene's air.

    material : of `materials.air`
    mitsuba : the scene's file, which stays where it is;  folder : where the files will lie
    name : of the recipe, and of the picture
    view : of `renderers.mitsuba.extent.seen`, in units of the scene
    unit : length of 1 in the scene, one of `meshes.UNITS`; a metre if None

    Returns files and remarks, as `studio.in_studio`.
    """
    metres = UNITS[unit or "m"]
    why = "as asked (--unit)" if unit else "ASSUMED, Mitsuba's files have no unit (change it with --unit)"
    text, remarks = material.text(name), [f"{mitsuba.name}: one unit is 1 {unit or 'm'}, {why}"]
    if view.sensors > 1:
        remarks.append(f"of its {view.sensors} sensors the first is the camera")
    recipe = load(material.path)
    baked = draft.medium(recipe, {}, Cache())
    unchanged = CONTRAST / float(np.mean(baked.sigma_t))
    wanted = CONTRAST * view.depth * metres / math.log(2)  # half of the contrast is left at the middle of what is seen
    visibility = min(max(wanted, THICKEST), THINNEST)
    text, count = _DENSITY.subn(lambda match: _density(match, recipe, unchanged / visibility, visibility), text, count=1)
    if count:
        contrast = math.exp(-CONTRAST * view.depth * metres / visibility)
        remarks.append(f"visibility {length(visibility)}: things {length(view.depth * metres)} away, the median that the camera "
                       f"sees, keep {100 * contrast:.0f} % of their contrast; number_density in the recipe changes it")
    else:
        remarks.append(f"visibility {length(unchanged)}, which is the recipe's")
    margin = 0.05 * float(np.max(view.high - view.low))
    lo, hi = (metres * corner for corner in (view.low - margin, view.high + margin))
    where = f"{{box: {{lo: {_corner(lo)}, hi: {_corner(hi)}}}}}" if view.sky else "everywhere"
    remarks.append("in a box around the scene, because light from infinity (sky, sun) does not get into fog without an end"
                   if view.sky else "everywhere")
    scene = _scene(name, mitsuba, folder, unit or "m", where, remarks)
    return material.files(name) | {f"{name}.yaml": text, f"{name}.scene.yaml": scene}, remarks


def _density(match, recipe, factor, visibility) -> str:
    return (f"{match[1]}number_density: {factor * float(recipe.particles.number_density):.3g} /m^3".ljust(40)
            + f"# chosen for a visibility of {length(visibility)}")


def _scene(name, mitsuba, folder, unit, where, remarks) -> str:
    facts = "\n".join(f"# - {remark}" for remark in remarks)
    path = Path(os.path.relpath(mitsuba.resolve(), folder.resolve())).as_posix()
    return f"""# {name.replace("_", " ").capitalize()} in {mitsuba.name}, whose surfaces, lights and camera are kept.
{facts}
bakery_scene: 2
name: {name}
scene: {{mitsuba: {path}, unit: {written(unit)}}}
# No pass is begun after this time.  In its place, or besides: noise: 2%.
stop: {{time: 60 s}}
materials:
  - {{where: {where}, recipe: {name}.yaml}}
# How the PNG shows the light: exposure, a factor.  The EXR is linear.
display: {{exposure: 1}}
"""


def _corner(values) -> str:
    return "[" + ", ".join(f"{value:.4g}" for value in values) + "] m"
