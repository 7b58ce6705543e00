"""What `auto` costs in a minute beside each method that it may take: pilots, and a choice that is not the cheapest.

    python -m benchmarks.auto [SCENE …] [--minute 60] [--cores 2] [--seconds 5] [--stock] [--bakes]

Nothing is rendered for a minute: what a picture of equal noise takes by `auto` over a fixed method is the ratio of what both take
to a noise, and the share of the minute that choosing takes beside it.  The choice is made anew, twice, with `stop.time` of a
minute; the second one counts, as kernels are compiled then.  Then all candidates render films of 64 x 64 pixels in turns for some
processor seconds each: variance times time, of several kinds of passes as they are shared out best.  A row a candidate; `auto
over it`: what `auto` takes over what that takes, choosing included, by the mean square over pixels and by the median pixel, which
fireflies do not decide, and which is too low where a pixel has had few samples.  --stock: Mitsuba's `volpath` and `volpathmis`
as well, of bodies, and of boxes behind them in the list, as media of one Henyey-Greenstein lobe.  --bakes: processor seconds of
the bakes that a cache without this scene takes, with `auto` and with each candidate.  Rough: variances of few passes are known to
some 10 %.
"""

import argparse
import os
import tempfile
import time
from itertools import product
from pathlib import Path
from unittest import mock
from xml.etree import ElementTree

import numpy as np
from scipy.stats import chi2

from bakery.errors import BakeryError
from benchmarks.requirements import SCENES
from benchmarks.sizes import sized
from renderers import choice, colour
from renderers.choice import remembered, surfaces, trial
from renderers.mitsuba.world import World
from renderers.pictures.engine import Part
from renderers.scene import assets, candidates, load

DEFAULT = ["glass_of_milk", "candle", "sand_castle", "lamp_in_dust", "bubbles_in_light", "winter_evening"]
STOCK = 16  # samples a pixel of a pass by Mitsuba's own integrators
# Depths from which their roulette ends paths: 5, as they have it, leaves bodies of an albedo near 1 too dark, as the bright paths
# that bring much of their light are hardly ever drawn
ROULETTE = 5, 1000


def chosen(scene, cores):
    """The choice, and processor seconds that it takes once kernels are compiled; by the clock of a machine whose processors, so
    many, do nothing else and are always busy."""
    with mock.patch.object(remembered, "get", lambda *_: None), mock.patch.object(remembered, "put", lambda *_: None), \
            mock.patch("time.monotonic", lambda: time.process_time() / cores):
        for _ in range(2):
            opened, world = choice.Opened.of(scene), World.of(scene)
            begin = time.process_time()
            taken = choice.chosen(opened, world)
            spent = time.process_time() - begin
    return taken, spent


def parts_of(candidate, opened, world):
    """Kinds of passes of a candidate."""
    asked = candidates.by_methods(opened.scene, candidate.methods)
    with world.as_it_is():
        return asked.prepare(opened._replace(scene=asked), world, 7).parts


def stock(opened, world, integrator, roulette):
    """Passes of Mitsuba's own integrator over the same film, with media in the bodies and boxes of a scene, whose BSDF is the
    boundary already; roulette : depth from which it ends paths."""
    import mitsuba as mi

    path = opened.scene.file(opened.scene.values.scene.mitsuba)
    root, bodies = ElementTree.parse(path).getroot(), []
    shapes = {shape.get("id"): shape for shape in root.iter("shape")}
    for old in root.findall("integrator"):
        root.remove(old)
    root.append(ElementTree.fromstring(f'<integrator type="{integrator}"><integer name="max_depth" value="-1"/>'
                                       f'<integer name="rr_depth" value="{roulette}"/></integrator>'))
    film = root.find("sensor/film")
    film[:] = [ElementTree.fromstring(f'<integer name="{name}" value="{size}"/>')
               for name, size in zip(("height", "width"), world.size)] + [ElementTree.fromstring('<rfilter type="box"/>')]
    for entry, asset in zip(opened.scene.values.materials, opened.assets, strict=True):
        if entry.kind == "body":
            bodies.append(shapes[entry.where.shape])
            bodies[-1].append(medium(asset.medium, "interior", opened.scene.values.scene.unit))
        else:
            shape = box(entry.where.box, opened.scene.values.scene.unit)
            root.append(shape)
            shape.append(medium(asset.medium, "interior", opened.scene.values.scene.unit))
            for body in bodies:
                body.append(medium(asset.medium, "exterior", opened.scene.values.scene.unit))
    with tempfile.NamedTemporaryFile("w", suffix=".xml", dir=path.parent) as file:
        file.write(ElementTree.tostring(root, encoding="unicode"))
        file.flush()
        loaded = mi.load_file(file.name, optimize=False)
    return (Part(integrator, lambda number: {"": np.array(mi.render(loaded, spp=STOCK, seed=number), float)[..., :3]}, STOCK),)


def medium(averages, side, unit):
    """Of Mitsuba; side : interior or exterior;  unit : m"""
    sigma_t = np.asarray(averages.sigma_t, float) * unit
    sigma, albedo = (", ".join(map(str, values)) for values in (sigma_t / sigma_t.max(), np.asarray(averages.albedo, float)))
    return ElementTree.fromstring(
        f'<medium type="homogeneous" name="{side}"><rgb name="sigma_t" value="{sigma}"/><rgb name="albedo" value="{albedo}"/>'
        f'<float name="scale" value="{sigma_t.max()}"/><phase type="hg"><float name="g" value="{np.mean(averages.g)}"/></phase>'
        '</medium>')


def box(corners, unit):
    """A cube of Mitsuba that refracts nothing."""
    low, high = (np.array(corner, float) / unit for corner in (corners.lo, corners.hi))
    scale, centre = (", ".join(map(str, values)) for values in ((high - low) / 2, (high + low) / 2))
    return ElementTree.fromstring(f'<shape type="cube"><transform name="to_world"><scale value="{scale}"/><translate '
                                  f'value="{centre}"/></transform><bsdf type="null"/></shape>')


class Engine:
    """Kinds of passes on a small film."""

    def __init__(self, world, parts):
        self._world, self._parts = world, parts
        self._luminance = {part.name: [] for part in self._parts}
        self._seconds = {part.name: [] for part in self._parts}
        self.spent = 0.0

    def go(self):
        for part in self._parts:
            begin = time.process_time()
            with self._world.as_it_is():
                layers = part.render(len(self._luminance[part.name]))
            self._seconds[part.name].append(time.process_time() - begin)
            self._luminance[part.name].append(np.asarray(layers[""], float) @ colour.LUMINANCE)
            self.spent += self._seconds[part.name][-1] if len(self._seconds[part.name]) > 1 else 0.0

    def measured(self):
        """Processor seconds times relative variance, by the mean and by the median over pixels, and the mean."""
        level = sum(np.mean(images) for images in self._luminance.values())
        roots = []
        for name, images in self._luminance.items():
            variance, freedom = np.var(images, axis=0, ddof=1), len(images) - 1
            # of few passes the median of variances is low: by as much as that of normal noise
            both = np.array([variance.mean(), np.median(variance) * freedom / chi2.median(freedom)])
            roots.append(np.sqrt(both * np.median(self._seconds[name][1:])))
        return *((sum(roots) / level) ** 2), level


def rates(scene, seconds, with_stock=False):
    """Name of each candidate that can render the scene, and of integrators of Mitsuba -> `Engine.measured`."""
    opened, world = choice.Opened.of(scene), World.of(scene)
    offered, lacks = surfaces.beside(opened, world, candidates.of(scene))
    offered = [candidate for candidate in offered if candidate.name not in lacks and not candidate.lacks(opened.assets, world)]
    offered = offered or [candidates.Candidate("auto", tuple(entry.method for entry in scene.values.materials))]
    small = trial.smaller(world, trial.SMALL)
    engines = {}
    for candidate in offered:
        try:
            engines[candidate.name] = Engine(small, parts_of(candidate, opened, small))
        except BakeryError:  # tables that are not baked: no candidate
            continue
    for name, roulette in product(("volpath", "volpathmis"), ROULETTE) if with_stock else ():
        engines[f"{name}, roulette from {roulette}"] = Engine(small, stock(opened, small, name, roulette))
    while slow := [engine for engine in engines.values() if engine.spent < seconds]:
        for engine in slow:
            engine.go()
    return {name: engine.measured() for name, engine in engines.items()}


def bakes(path, settings):
    """Processor seconds of what a scene bakes into an empty cache."""
    with tempfile.TemporaryDirectory() as folder, mock.patch.dict(os.environ, {"BAKERY_CACHE": folder}):
        begin = time.process_time()
        assets.baked(load(path, settings))
        return time.process_time() - begin


def rows(path, options):
    settings = {"stop.time": f"{options.minute} s"}
    scene = assets.baked(load(path, settings))
    taken, spent = chosen(scene, options.cores)
    share = spent / (options.minute * options.cores)
    measured = rates(scene, options.seconds, options.stock)
    method = taken.method if taken else "auto"  # of one candidate nothing is chosen
    own = np.array(measured[method][:2]) / (1 - share)
    for name, (rate, median, level) in measured.items():
        baked = f" {bakes(path, settings | {'method': name}):.1f} |" if options.bakes and " " not in name else ""
        over, of_median = own / (rate, median)
        print(f"| {path.stem} | {name}{' *' if name == method else ''} | {rate:.3g} | {level:.4g} | {100 * share:.1f} % | "
              f"{over:.2f} | {of_median:.2f} |{baked}", flush=True)
    if options.bakes:
        print(f"    with auto baking takes {bakes(path, settings):.1f} s")
    print(f"    {taken.sentence if taken else 'there is nothing to choose'}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", help="names, or files NAME.yaml")
    parser.add_argument("--minute", type=float, default=60.0, help="s of the clock that a picture is given")
    parser.add_argument("--cores", type=float, default=2.0, help="processor seconds in a second")
    parser.add_argument("--seconds", type=float, default=sized(5.0, 0.1), help="of a processor, for each candidate")
    parser.add_argument("--stock", action="store_true")
    parser.add_argument("--bakes", action="store_true")
    options = parser.parse_args()
    print("| scene | candidate (* taken) | variance x time | mean | choosing, of a minute | auto over it | by the median pixel |")
    print("|---|---|---|---|---|---|---|")
    for name in options.scenes or sized(DEFAULT, ["candle"]):
        rows(Path(name).resolve() if name.endswith(".yaml") else SCENES / f"{name}.yaml", options)


if __name__ == "__main__":
    main()
