"""What scenes need of a recipe, before anything is baked: which stages, which of their knobs, and the number that decided each.

A renderer declares it in its module `requirements`, `needs(about) -> list[Need]`, from a scene and a recipe: by closed formulas,
and by rays that measure the scene.  Here is what the rules of all renderers work with, and the union over scenes.  A renderer
without that module needs the stages `NEEDS` of its module `scene`, with the recipe's own knobs.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from bakery.errors import BakeryError, RecipeError
from renderers import scene as scenes
from renderers.scene import budget, meshes
from renderers.scene.inputs import sources_of

# Seconds of one core, in units of costs of stages, up to which classes of spheres go by series: to measure rays and to take them
# saves less.  Of dust (4.1 of these) series take 0.5 s more, of snowfall (7.0) 4 s more; a machine that has compiled no kernels
# of rays compiles 12 s for them
_SERIES = 8.0


class Knob(NamedTuple):
    """A value of a recipe that a scene decides.

    key : of the recipe
    value : as `recipe.leaves` has it: a number in base units, or a word
    text : the same as a recipe says it
    why : with the number that decided it
    larger : whether larger numbers ask for more; of tolerances smaller ones do
    words : of words, from the one that asks for least
    """

    key: str
    value: float | str
    text: str
    why: str
    larger: bool = True
    words: tuple[str, ...] = ()

    def demand(self, value) -> float:
        """What a value asks for: more where it is larger; nan of a value that cannot be compared."""
        if value in self.words:
            return self.words.index(value)
        return math.nan if not isinstance(value, (int, float)) else float(value) if self.larger else -float(value)


class Need(NamedTuple):
    """Whether a scene needs a stage, and why.

    stage : its name
    needed : whether the renderer reads it
    why : with the number that decided it
    knobs : what the scene decides of it; the others stay as the recipe has them
    lacking : what the scene asks for and the stage cannot give, and by how much; "" where it can
    """

    stage: str
    needed: bool
    why: str
    knobs: tuple[Knob, ...] = ()
    lacking: str = ""

    def of(self, name: str) -> "Need":
        """The same with a scene's name behind each reason."""
        knobs = (knob._replace(why=f"{knob.why} ({name})") for knob in self.knobs)
        return self._replace(why=f"{self.why} ({name})", knobs=tuple(knobs), lacking=self.lacking and f"{self.lacking} ({name})")

    def as_dict(self) -> dict:
        """The same for machines (`--json`)."""
        return self._asdict() | {"knobs": [{"key": knob.key, "value": knob.text, "why": knob.why} for knob in self.knobs]}


class Required(NamedTuple):
    """What scenes need of one recipe.

    needs : of each stage that a scene speaks of
    remarks : scenes that could not be measured, and why; tolerances that are out of reach
    share : of the tolerance's square that tables may take, see `renderers.scene.budget`; of one scene
    read : files that the scenes are made of, but for their assets
    """

    needs: tuple[Need, ...]
    remarks: tuple[str, ...] = ()
    share: float = budget.HALF
    read: tuple[Path, ...] = ()

    @property
    def stages(self) -> tuple[str, ...]:
        """Names of the stages that are needed."""
        return tuple(need.stage for need in self.needs if need.needed)

    @property
    def settings(self) -> dict[str, str]:
        """Recipe key -> text, of the stages that are needed."""
        return {knob.key: knob.text for need in self.needs if need.needed for knob in need.knobs}


class About:
    """A scene and a recipe, as rules see them.

    scene : `renderers.scene.Scene`; its assets need not be there
    recipe : checked values of the recipe
    bodies : of the scene that the recipe is the material of, positions in `scene.materials`; all, where it is none of theirs
    guessed : whether it is none of theirs
    worlds : `renderers.mitsuba.world.World` by the `id` of its scene, of those that were loaded
    split : `renderers.scene.budget.Split` of the tolerance; a rule is asked with several
    """

    def __init__(self, scene, recipe, medium: Callable, bodies: Sequence[int] | None = None, worlds: dict | None = None):
        self.scene, self.recipe, self._medium, self._measured = scene, recipe, medium, {}
        self.worlds = {} if worlds is None else worlds
        self._whole = None  # of a part; not itself, which would keep its worlds from going with it
        self.split = budget.of(scene, budget.HALF)
        if bodies is None:  # it is theirs, or an asset of its name
            names, path = (recipe.name, Path(recipe.path).stem), Path(recipe.path).resolve()
            bodies = [number for number, entry in enumerate(scene.materials)
                      if entry.recipe and scene.file(entry.recipe).resolve() == path
                      or entry.asset and Path(entry.asset).stem in names]
        made_of_it = list(bodies)
        self.guessed = not made_of_it
        self.bodies = made_of_it or list(range(len(scene.materials)))

    def only(self, bodies: Sequence[int], method: str) -> "About":
        """The same of some of its bodies, rendered by a method."""
        values = self.scene.values
        listed = [entry.model_copy(update={"method": method}) if number in bodies else entry
                  for number, entry in enumerate(values.materials)]
        part = copy(self)
        part._whole = self._whole or self
        part.scene = dataclasses.replace(self.scene, values=values.model_copy(update={"materials": listed, "method": method}))
        part.bodies, part._measured = list(bodies), self._measured.setdefault((tuple(bodies), method), {})
        return part

    @property
    def entry(self):
        """Of the scene's `materials`, the first one that the recipe is the material of."""
        return self.scene.values.materials[self.bodies[0]]

    @property
    def tolerance(self) -> float:
        """Of the picture."""
        return self.split.tolerance

    @property
    def tables(self) -> float:
        """What tables of the asset may change the picture by: where each pixel counts, less, as their errors gather in few."""
        return self.split.tables / (budget.GATHERED if self.scene.values.measure == "pixels" else 1.0)

    def measured(self, measure: Callable):
        """What a function of this measures of scene and recipe, once: nothing that goes by the tolerance."""
        if measure not in self._measured:
            self._measured[measure] = measure(self)
        return self._measured[measure]

    @property
    def share(self) -> str:
        """What tables may take, in words."""
        words = f"tables may take {100 * self.tables:.3g} % of the picture's {100 * self.tolerance:.3g} %"
        return f"{words}: {self.split.why}" if self.split.why else words

    @property
    def medium(self):
        """The medium by a draft bake: `wavelength` (L,) um, `sigma_t` (L,) 1/m, `albedo`, `g` (L,)."""
        return (self._whole or self).measured(_medium)

    @property
    def world(self):
        """Surfaces, lights and camera, `renderers.mitsuba.world.World`."""
        whole = (self._whole or self).scene
        if id(whole) not in self.worlds:
            self.worlds[id(whole)] = meshes.world_of(whole)
        return self.worlds[id(whole)]

    @property
    def dark(self) -> bool:
        """Whether nothing in the scene shines."""
        return self.world.dark

    @property
    def camera(self):
        """Of the world; UsageError where there is none."""
        if self.world.camera is None:
            raise self.scene.no_camera()
        return self.world.camera


def _medium(about):
    return about._medium()


def of(paths: Sequence, recipe, medium: Callable, seconds: Callable, settings: Mapping[str, str] | None = None) -> Required:
    """What the union of some scenes needs of a recipe.

    paths : of scenes (YAML, or Mitsuba's XML)
    recipe : checked values of the recipe (`bakery.recipe`)
    medium : () -> its medium by a draft bake, see `About.medium`; called where a rule asks for it
    seconds : (Required) -> what a bake of it takes, of one core
    settings : overrides of the scenes' values, dotted key -> text

    Raises UsageError, RecipeError: a path is no scene, or names no renderer.
    """
    each_scene = [_of_scene(Path(path), recipe, medium, seconds, settings or {}) for path in paths]
    if len(each_scene) > 1:
        each_scene = [required._replace(needs=tuple(need.of(Path(path).name) for need in required.needs))
                      for path, required in zip(paths, each_scene, strict=True)]
    return _together(each_scene, recipe.leaves)._replace(share=budget.HALF)


def of_scene(scene, recipe, medium: Callable, seconds: Callable, worlds: dict | None = None) -> Required:
    """The same of one scene that is read already.

    worlds : as of `About`, which those of several recipes share while the scene lives

    Raises BakeryError where it cannot be measured.
    """
    about = About(scene, recipe, medium, worlds=worlds)
    _refuse_layers(about)
    return _shared_out(about, _rules(scene), seconds)._replace(read=tuple(scene.sources))


def _refuse_layers(about) -> None:
    """UsageError where an entry asks for a layer that its recipe does not have: before minutes of a bake."""
    surface = about.recipe.surface
    count = 1 if surface is None or surface.thickness == "infinite" else len(surface.thickness)
    for number in () if about.guessed else about.bodies:
        layer = getattr(about.scene.materials[number], "layer", None) or 0
        if layer >= count:
            raise about.scene.wrong(f"materials[{number}].layer", f"found no layer {layer}; {about.recipe.path} has {count}: "
                                    f"0 to {count - 1}")


def of_scenes(listed: Sequence, recipe, medium: Callable, seconds: Callable, worlds: dict | None = None) -> Required:
    """The same of several that are read already, such as frames of one sequence; the share is the largest that any gives."""
    required = [of_scene(scene, recipe, medium, seconds, worlds) for scene in listed]
    return required[0] if len(required) == 1 else _together(required, recipe.leaves)


def _together(required: Sequence[Required], leaves: Mapping) -> Required:
    """The union."""
    remarks, files = (tuple(dict.fromkeys(item for asked in required for item in getattr(asked, name)))
                      for name in ("remarks", "read"))
    return Required(merged([asked.needs for asked in required], leaves), remarks, max(asked.share for asked in required), files)


def _shared_out(about, rules, seconds) -> Required:
    """The needs by the split that takes least.

    A scene that names an asset is rendered as if its tables had half: whoever baked them, the renderer does not ask.
    """
    def needs(split):
        about.split = split
        strangers = [f"{about.scene.path}: no material uses {about.recipe.path}; it is taken for all"] * about.guessed
        required = Required(tuple(rules(about)), (*strangers, *_out_of_reach(about)), split.share)
        return _by_series(required, about.recipe, seconds)

    scene = about.scene
    pace, named = getattr(scene.rules, "PACE", None), [entry.asset for entry in scene.materials]
    if pace is None or any(named) or about.dark:
        return needs(about.split)
    height, width = about.world.size

    def baking(split):
        required = needs(split)
        return math.inf if any(need.lacking for need in required.needs) else seconds(required)

    return needs(budget.cheapest(scene, height * width, pace, baking))


def _by_series(required, recipe, seconds) -> Required:
    """The same with classes of spheres by series, where the recipe leaves that to the stage and they take little time."""
    needs = {need.stage: need for need in required.needs if need.needed}
    if "discrete" not in needs or "optics" not in needs or recipe.phase.method != "auto":
        return required

    def decided(why):
        # no word asks for more: what was baked by rays that are good enough will do
        knob = Knob("phase.method", "mie", "mie", why, words=("mie",))
        of_spheres = needs["optics"]._replace(knobs=(*needs["optics"].knobs, knob))
        return required._replace(needs=tuple(of_spheres if need is needs["optics"] else need for need in required.needs))

    took = seconds(decided(""))
    return decided(f"series take {took:.2g} s, about as much as measuring how good rays are") if took < _SERIES else required


def _out_of_reach(about):
    """What noise and approximations alone leave no room for."""
    scene, split = about.scene, about.split
    noise = scene.values.stop.noise
    if noise is not None and noise > split.tolerance:
        yield f"{scene.path}: noise (stop.noise) of {100 * noise:.3g} % leaves the tolerance of {100 * split.tolerance:.3g} % " \
              f"out of reach, {budget.as_much(noise / split.tolerance)}"
        return
    if split.lacking:
        yield from (f"{scene.path}: {reason}" for reason in split.lacking)
        return
    if (all_of_it := math.hypot(split.approximations, split.tables, split.noise)) > 1.001 * split.tolerance:
        yield f"{scene.path}: noise (stop.noise) of {100 * split.noise:.3g} % leaves too little of the tolerance of " \
              f"{100 * split.tolerance:.3g} % to tables: with theirs the picture is within {100 * all_of_it:.3g} %"


def _of_scene(path, recipe, medium, seconds, settings) -> Required:
    stages = scenes.needs(path)
    if path.suffix.lower() not in scenes.SUFFIXES:
        return Required(tuple(Need(stage, True, "bakery's plugins for Mitsuba read it") for stage in stages),
                        read=tuple(sources_of(path)))
    try:
        scene = scenes.load(path, settings, assets=False)
    except RecipeError as fault:
        if not scenes.unfinished(fault):
            raise
        return _unmeasured(stages, path, fault)._replace(read=(path,))
    try:
        return of_scene(scene, recipe, medium, seconds)
    except BakeryError as fault:
        return _unmeasured(stages, path, fault)._replace(read=tuple(scene.sources))


def _unmeasured(stages, path, fault) -> Required:
    """The stages alone; what is wrong with the scene is said, not passed over."""
    return Required(tuple(Need(stage, True, "the renderer reads it") for stage in stages),
                    (f"{path}: the recipe's keys stay, because the scene could not be measured: {fault}",))


def _rules(scene) -> Callable:
    """`needs` of the scene's renderer."""
    module = f"{scene.renderer}.requirements"
    if find_spec(module) is None:
        return lambda about: [Need(stage, True, "the renderer reads it") for stage in scene.rules.NEEDS]
    return import_module(module).needs


# ---- the union


def merged(listed: Sequence[Sequence[Need]], leaves: Mapping) -> tuple[Need, ...]:
    """The union: stages that any needs, and of each knob the value that asks for most.

    leaves : values of the recipe, which hold where one of the scenes that need a stage leaves a knob to it
    """
    stages = list(dict.fromkeys(need.stage for needs in listed for need in needs))
    return tuple(_union([need for needs in listed for need in needs if need.stage == stage], leaves) for stage in stages)


def _union(needs: Sequence[Need], leaves) -> Need:
    wanted = [need for need in needs if need.needed] or list(needs)
    by_key: dict[str, list[Knob]] = {}
    for need in wanted:
        for knob in need.knobs:
            by_key.setdefault(knob.key, []).append(knob)
    knobs = [_most(same, len(wanted), leaves.get(key)) for key, same in by_key.items()]
    reasons, lacking = (dict.fromkeys(getattr(need, name) for need in wanted) for name in ("why", "lacking"))
    return Need(wanted[0].stage, wanted[0].needed, "; ".join(reasons), tuple(filter(None, knobs)),
                "; ".join(filter(None, lacking)))


def _most(knobs: Sequence[Knob], scenes_: int, as_written) -> Knob | None:
    """The knob that asks for most; None where the recipe's own value, which holds for the other scenes, asks for as much."""
    best = max(knobs, key=lambda knob: knob.demand(knob.value))
    if len(knobs) < scenes_ and not best.demand(best.value) > best.demand(as_written):
        return None  # also where the recipe leaves the value to the stage
    return best
