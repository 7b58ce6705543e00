"""Scenes of translucent bodies by Mitsuba's path tracer: python benchmarks/translucent_reference.py [SCENE.yaml ...] [-o FOLDER]

Each scene becomes a plain Mitsuba scene: in each body a homogeneous medium with the asset's sigma_t, albedo and phase function
(`bakedphase`; with --hg the Henyey-Greenstein function of the same g), rendered by `volpath` without a limit of depth.  One
render a colour, whose medium is grey: no path carries the weights of several colours.  Writes NAME.npz (mean and its standard
error `noise`: (H, W, 3), linear; samples), NAME.exr and NAME.png, and prints a row a scene: sizes of its first body, events of
scattering, mean, noise, and processor seconds to a noise of 1 %.  Assets are taken from FOLDER or baked there.

--room: what is seen of a ball of albedo 1 in a room of radiance 1, which has to be 1, for boundaries and phase functions.
"""

import argparse
import math
import time
import xml.etree.ElementTree as xml
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML

import bakery
import renderers.mitsuba  # noqa: F401
from benchmarks.sizes import sized
from renderers.mitsuba import passes, variants
from renderers.pictures import images

DEEP = 1_000_000  # events without roulette: in effect none
METRES = {"1 mm": 1e-3, "1 cm": 1e-2, "1 m": 1.0}


class Medium:
    """What a body is filled with, by colour."""

    def __init__(self, path, unit):
        asset = bakery.open(path)
        self.path, self.unit = str(Path(path).resolve()), unit
        self.sigma_t, self.albedo, self.g = (np.asarray(getattr(asset.medium, key)) for key in ("sigma_t", "albedo", "g"))
        self.sigma_t = self.sigma_t * unit

    def element(self, colour, hg, albedo):
        """XML of the grey medium of one colour."""
        node = xml.Element("medium", type="homogeneous", name="interior")
        for name, value in (("sigma_t", self.sigma_t[colour]), ("albedo", albedo)):
            xml.SubElement(node, "spectrum", name=name, value=repr(float(value)))
        if hg:
            phase = xml.SubElement(node, "phase", type="hg")
            xml.SubElement(phase, "float", name="g", value=repr(float(self.g[colour])))
        else:
            phase = xml.SubElement(node, "phase", type="bakedphase")
            xml.SubElement(phase, "string", name="filename", value=self.path)
            xml.SubElement(phase, "integer", name="channel", value=str(colour))
        return node


class Scene:
    """A scene file, whose assets are in `assets` as NAME.h5 or are baked there."""

    def __init__(self, path, assets):
        self.path, said = Path(path), YAML(typ="safe").load(Path(path))
        self.name, unit = said["name"], METRES[said["scene"]["unit"]]
        self.file = self.path.parent / said["scene"]["mitsuba"]
        self.media = {}
        for body in said["materials"]:
            recipe = self.path.parent / body.get("recipe", body.get("asset"))
            baked = recipe if recipe.suffix == ".h5" else assets / f"{recipe.stem}.h5"
            if not baked.exists():
                bakery.bake(recipe, output=baked, stages=["medium"])
            self.media[body["where"]["shape"]] = Medium(baked, unit)

    def tree(self, size, colour, hg=False, factor=1.0, deep=None):
        """Mitsuba's XML; `factor` multiplies the albedo, `deep` is the event at which roulette starts."""
        root = xml.parse(self.file).getroot()
        albedo = {name: factor * medium.albedo[colour] for name, medium in self.media.items()}
        for shape in root.iter("shape"):
            if shape.get("id") in self.media:
                shape.append(self.media[shape.get("id")].element(colour, hg, albedo[shape.get("id")]))
        for node in root.findall("integrator"):
            root.remove(node)
        integrator = xml.SubElement(root, "integrator", type="volpath")
        if deep is None:
            # Mitsuba's roulette ends 5 % of the paths an event or more: above an albedo of 0.95 the weights of those left grow
            # (one path of the bust held 86 % of the picture's variance).  So it waits until 0.25 % of the light is left,
            # and where little is absorbed, so that paths rather leave the body, there is none.
            most = max(albedo.values())
            deep = 5 + int(6 / (1 - most)) if most < 0.99 else DEEP
        for key, value in (("max_depth", -1), ("rr_depth", deep)):
            xml.SubElement(integrator, "integer", name=key, value=str(value))
        film = root.find("sensor/film")
        for node in film.findall("integer"):
            node.set("value", str(size))
        xml.SubElement(film, "rfilter", type="box")
        return xml.tostring(root, encoding="unicode")

    def loaded(self, *args, **settings):
        import mitsuba as mi

        resolver = mi.file_resolver()
        resolver.append(str(self.file.parent.resolve()))
        return mi.load_string(self.tree(*args, **settings))


def rendered(scene, samples, seed):
    """(H, W, 3), with samples that are no number as dark."""
    import mitsuba as mi

    image = np.array(mi.render(scene, spp=samples, seed=seed), dtype=float)[..., :3]
    return np.where(np.isfinite(image), image, 0.0)


def reference(scene, size, samples, seconds, hg):
    """Mean and noise (standard error) (H, W, 3) from passes, their samples, and processor seconds of all threads."""
    loaded = [scene.loaded(size, colour, hg) for colour in range(3)]
    per_pass = max(1, min(samples // 4, passes.PATHS // size**2))
    total, square, count = 0.0, 0.0, 0
    for one in loaded:
        rendered(one, per_pass, 987)  # compiles
    begin, spent = time.perf_counter(), time.process_time()
    while count < 4 or (count * per_pass < samples and time.perf_counter() - begin < seconds):
        image = np.stack([rendered(one, per_pass, count)[..., colour] for colour, one in enumerate(loaded)], -1)
        total, square, count = total + image, square + image**2, count + 1
    mean = total / count
    variance = np.maximum(square / count - mean**2, 0) / (count - 1)
    return mean, np.sqrt(variance), count * per_pass, time.process_time() - spent


def events(scene, size, samples, hg, step=0.01):
    """Mean number of scattering events of the light seen that was scattered, by colour.

    d log L / d log albedo: light of n events goes as albedo^n.  All three pictures have the same paths, none ended by roulette.
    """
    def light(colour, factor):
        loaded = scene.loaded(size, colour, hg, factor, DEEP)
        return sum(rendered(loaded, samples, seed)[..., colour].sum() for seed in (1, 2))

    found = []
    for colour in range(3):
        dark, less, full = (light(colour, factor) for factor in (0.0, 1 - step, 1.0))
        found.append(math.log((full - dark) / (less - dark)) / -math.log1p(-step))
    return found


def sizes(scene):
    """Of each body: its medium, the edges of the box around it and its mean chord 4 V/S in mean free paths of each colour."""
    for shape in scene.loaded(8, 0).shapes():
        if shape.id() in scene.media:
            medium = scene.media[shape.id()]
            vertices = np.array(shape.vertex_positions_buffer(), float).reshape(-1, 3)
            corner = vertices[np.array(shape.faces_buffer(), int).reshape(-1, 3)]
            cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
            chord = 4 * np.einsum("ij,ij->", corner[:, 0], cross) / 6 / (np.linalg.norm(cross, axis=1).sum() / 2)
            yield medium, np.outer(np.ptp(vertices, axis=0), medium.sigma_t), chord * medium.sigma_t


def written(folder, name, mean, noise, samples):
    import mitsuba as mi

    np.savez_compressed(folder / f"{name}.npz", mean=mean.astype(np.float32), noise=noise.astype(np.float32), samples=samples)
    mi.Bitmap(mean.astype(np.float32)).write(str(folder / f"{name}.exr"))
    luminance = np.maximum(mean.mean(-1, keepdims=True), 1e-9)
    shown = mean * (1 + luminance / 16) / (1 + luminance)  # the scenes' own curve, white 4
    mi.util.write_bitmap(str(folder / f"{name}.png"), shown.astype(np.float32))


def several(numbers):
    return ", ".join(f"{number:.3g}" for number in np.ravel(numbers))


def table(scenes, args):
    print("| scene | 1/sigma_t, mm | albedo | g | box, free paths of green | mean chord, of red, green, blue | events | mean "
          "| noise | samples | processor s | to 1 % |\n|" + "---|" * 12, flush=True)
    for scene in scenes:
        medium, box, chord = next(sizes(scene))
        counted = events(scene, 32, 16, args.hg) if not args.quick else [np.nan] * 3
        mean, noise, samples, seconds = reference(scene, args.size, args.samples, args.time, args.hg)
        written(args.output, scene.name, mean, noise, samples)
        relative = images.relative_noise(mean, noise)
        print(f"| {scene.name} | {several(1e3 * medium.unit / medium.sigma_t)} | {several(medium.albedo)} | {medium.g[0]:.2f} | "
              f"{several(box[:, 1])} | {several(chord)} | {several(counted)} | {several(mean.mean((0, 1)))} | "
              f"{100 * relative:.2f} % | {samples} | {seconds:.0f} | {seconds * (relative / 0.01) ** 2:.2g} |", flush=True)


def room(asset, samples=sized(256, 2), size=sized(16, 4)):
    """A ball of radius 3 mean free paths in a room of radiance 1: mean of the picture, and its standard error."""
    import mitsuba as mi

    asset = Medium(asset, 1.0)
    phases = {"isotropic": {"type": "isotropic"}, "hg 0.8": {"type": "hg", "g": 0.8},
              f"bakedphase, g {asset.g[0]:.2f}": {"type": "bakedphase", "filename": asset.path, "channel": 0}}
    smooth, rough = {"type": "dielectric", "ext_ior": 1.0}, {"type": "roughdielectric", "ext_ior": 1.0, "distribution": "ggx"}
    boundaries = {"null": {"type": "null"}, "dielectric 1.446": {**smooth, "int_ior": 1.446},
                  "dielectric 1.35 in 1.5": {**smooth, "int_ior": 1.35, "ext_ior": 1.5},
                  "roughdielectric 1.4, alpha 0.1": {**rough, "int_ior": 1.4, "alpha": 0.1},
                  "roughdielectric 1.4, alpha 0.3": {**rough, "int_ior": 1.4, "alpha": 0.3}}
    sensor = {"type": "perspective", "fov": 20, "to_world": mi.ScalarTransform4f().look_at([0, -5, 0], [0, 0, 0], [0, 0, 1]),
              "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}}}
    print("| boundary | phase function | radiance | standard error |\n|---|---|---|---|", flush=True)
    for boundary, bsdf in boundaries.items():
        for phase, function in phases.items():
            medium = {"type": "homogeneous", "sigma_t": 3.0, "albedo": 1.0, "phase": function}
            scene = mi.load_dict({
                "type": "scene", "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": DEEP}, "sensor": sensor,
                "sky": {"type": "constant"}, "ball": {"type": "sphere", "bsdf": bsdf, "interior": medium}})
            means = [rendered(scene, samples, seed).mean() for seed in range(8)]
            print(f"| {boundary} | {phase} | {np.mean(means):.5f} | {np.std(means, ddof=1) / 8**0.5:.5f} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", nargs="*", default=sized([], [Path("assets/scenes/bumpy_ball.yaml")]))
    parser.add_argument("-o", "--output", type=Path, default=Path("build/translucent"))
    parser.add_argument("--size", type=int, default=sized(128, 8))
    parser.add_argument("--samples", type=int, default=sized(256, 2))
    parser.add_argument("--time", type=float, default=sized(120, 1), help="seconds a scene")
    parser.add_argument("--variant")
    parser.add_argument("--hg", action="store_true")
    parser.add_argument("--quick", action="store_true", help="without the number of events")
    parser.add_argument("--room", metavar="ASSET", help="whose phase function is one of those")
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    print(variants.activate("rgb", args.variant))
    if args.room:
        room(args.room)
    if args.scenes:
        table([Scene(path, args.output) for path in args.scenes], args)


if __name__ == "__main__":
    main()
