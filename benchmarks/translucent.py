"""The methods of the renderer of translucent bodies against each other, and against Mitsuba's `volpath`.

    python benchmarks/translucent.py [--scenes bumpy_ball candle] [--methods paths vrl vrl+tables ...] [--width 128]
                                     [--seconds 60] [--rounds 3]

Each method renders a shipped scene for so many seconds of processor time, in rounds that take turns.  Of pixels that see a body
with nothing in between but smooth glass (all pixels where none does): light of three and more events (`multiple`) and all light,
over that of the first method, and the processor time in which the error of a pixel would be 1 % of the mean (root mean square; of
methods with several kinds of passes at the best division between them), from the scatter of passes, for one and for all.
`mirrored` and `none` are `vrl+tables` with these boundaries.  Methods with rare bright pixels (vrl) need more than what few
passes say.
"""

import argparse
import time
from pathlib import Path

import numpy as np

from benchmarks.sizes import sized
from renderers import scene as scenes
from renderers.mitsuba.world import World
from renderers.pictures.running import Render

SCENES = Path(__file__).resolve().parents[1] / "assets" / "scenes"
METHODS = ("paths", "volpath", "vrl", "vrl+tables", "beams", "beams+tables", "mirrored", "none")
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


class Scene:
    """A shipped scene of so many pixels a side.

    seen : (H, W) bool, pixels whose middle sees a body; all where none does
    """

    def __init__(self, name, width, folder):
        from renderers.materials.bodies import methods, smooth, transport

        job = Render(scenes.load(SCENES / f"{name}.yaml", {"method": "vrl+tables"}), folder / f"{name}.png", overwrite=True)
        values, self.path = job.scene.values, SCENES / f"{name}.yaml"
        self.world = World(job.scene.file(values.scene.mitsuba), values.scene.unit, size=(width, width))
        bodies = values.materials
        self.how = methods.transport_of(self.world, [one.where.shape for one in bodies], job.assets, [None] * len(bodies),
                                        lambda number, key, message: ValueError(message))
        seen = smooth.seen(self.how, transport.begin(self.how, np.arange(width**2), 0, 0)).body >= 0
        self.seen = seen if seen.any() else ~seen

    def parts(self, method):
        """Kinds of passes of a method: functions of a pass's number -> layers."""
        from renderers.materials.bodies import methods

        if method == "volpath":
            return [self._volpath()]
        name, boundary = ("vrl+tables", method) if method in ("mirrored", "none") else (method, "negative")
        return [part.render for part in methods.of(self.how, name, boundary, 0)[1]]

    def _volpath(self):
        from benchmarks import translucent_reference as reference

        made = reference.Scene(self.path, self.path.parent)
        loaded = [made.loaded(self.world.size[0], colour) for colour in range(3)]

        def render(number):
            return {"": np.stack([reference.rendered(one, 4, number)[..., colour] for colour, one in enumerate(loaded)], -1)}

        return render


class Tally:
    """Mean of a layer over passes of one kind, and its scatter."""

    def __init__(self):
        self.count, self.mean, self.square, self.means = 0, 0.0, 0.0, []

    def add(self, image):
        self.count += 1
        change = image - self.mean
        self.mean = self.mean + change / self.count
        self.square = self.square + change * (image - self.mean)
        self.means.append(image.mean())

    @property
    def variance(self):
        """Of a pass."""
        return self.square / max(self.count - 1, 1)


class Run:
    """A method at work."""

    def __init__(self, scene, method):
        self.parts, self.seen, self.seconds = scene.parts(method), scene.seen, [0.0] * len(scene.parts(method))
        self.tallies = [{"multiple": Tally(), "all": Tally()} for _ in self.parts]
        for part in self.parts:
            part(10**6)  # compiles

    def go_on(self, seconds):
        for number, part in enumerate(self.parts):
            spent = 0.0
            while spent < seconds / len(self.parts) or self.tallies[number]["all"].count < 2:
                begin = time.process_time()
                layers = part(self.tallies[number]["all"].count)
                spent += time.process_time() - begin
                self.tallies[number]["all"].add(layers[""][self.seen] @ LUMINANCE)
                if "orders" in layers:
                    self.tallies[number]["multiple"].add(layers["orders"][self.seen] @ LUMINANCE)
            self.seconds[number] += spent

    def found(self, layer):
        """Mean over pixels, its standard error, and seconds to 1 % error of a pixel."""
        tallies = [tallies[layer] for tallies in self.tallies]
        if not all(tally.count for tally in tallies):
            return None
        mean = sum(tally.mean.mean() for tally in tallies)
        error = np.sqrt(sum(np.var(tally.means, ddof=1) / tally.count for tally in tallies))  # pixels share beams
        each = [seconds / tally.count for seconds, tally in zip(self.seconds, tallies)]
        spread = sum(np.sqrt(tally.variance.mean() * one) for tally, one in zip(tallies, each))
        return mean, error, (spread / mean / 0.01) ** 2


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=sized(["bumpy_ball", "candle"], ["candle"]))
    parser.add_argument("--methods", nargs="+", default=METHODS)
    parser.add_argument("--width", type=int, default=sized(128, 8))
    parser.add_argument("--seconds", type=float, default=sized(60, 0.0))
    parser.add_argument("--rounds", type=int, default=sized(3, 1))
    parser.add_argument("--folder", type=Path, default=Path("build/translucent"))
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    for name in args.scenes:
        scene = Scene(name, args.width, args.folder)
        runs = {method: Run(scene, method) for method in args.methods}
        for _ in range(args.rounds):
            for run in runs.values():
                run.go_on(args.seconds / args.rounds)
        print(f"\n{name}, {args.width} x {args.width}\n| method | multiple | seconds to 1 % | all | seconds to 1 % |")
        print("|---|---|---|---|---|")
        first = {layer: next(iter(runs.values())).found(layer) for layer in ("multiple", "all")}
        for method, run in runs.items():
            cells = []
            for layer in ("multiple", "all"):
                found = run.found(layer)
                cells += ["", ""] if found is None or first[layer] is None else [
                    f"{found[0] / first[layer][0]:.3f} ({found[1] / first[layer][0]:.3f})", f"{found[2]:.3g}"]
            print(f"| {method} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
