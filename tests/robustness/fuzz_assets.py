"""Structure-aware fuzzing of assets: sound ones changed in a few places, with right checksums, given to every command.

Each command must end with a status of the contract, within its time and memory, and say what is wrong in one line.  Run it as
`python -m tests.robustness.fuzz_assets --seconds 600`; a failure names its number, which `--only NUMBER` repeats.  With
`--members` the assets lack each of their members in turn, one at a time, and renderers read them as well.
"""

import argparse
import contextlib
import io
import os
import random
import resource
import signal
import sys
import tempfile
import time
import traceback
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np

from bakery.cli import status_of
from bakery.stages.conform import declared
from bakery.store.read import read
from bakery.store.tree import Dataset, Group
from bakery.store.write import write
from tests.samples import with_member

DRAWING = 180  # seconds of processor time of plot and report: photons beside tables take 34 of a sound asset here
TIME, MEMORY = 60, 1 << 30  # seconds of processor time of another command; bytes above what the process had taken
NUMBERS = (0.0, -0.0, 1.0, -1.0, 0.5, 2.0, 1e-300, 1e-30, 1e-9, 1e9, 1e30, 1e99, 1e300, np.nan, np.inf, -np.inf, 127, 2**31,
           -(2**31))
FACTORS = (1e-30, 1e-12, 0.5, 0.999, 1.001, 2, 128, 2048, 1e12, -1)
TYPES = ("f4", "f2", "i1", "u1", "i8", "u8", "c16", "?", "S5")
TEXTS = (b"", b"{}", b"[]", b"null", b"\xff\xfe", b"{" * 3000, b"[" * 100_000, b'{"type": 3}', b"\x1b[2J\x07", b"1e999",
         b"a\n" * 5000, b'{"multiple_scattering.orders": 100000, "type": "dielectric", "index": [1e300, -1]}')
RECIPES = {
    "drops": """\
bakery: 1
name: drops
wavelengths: [0.61, 0.465]
tolerance: 10%
phase: {polarized: true}
particles:
  host: air
  number_density: 1e8 /m^3
  components:
    - name: drops
      fraction: 0.9
      material: water
      size: {distribution: lognormal, radius: 0.5 um, sigma: 1.2, min: 0.1 um, max: 3 um}
    - {name: soot, fraction: 0.1, material: soot, size: {distribution: single, radius: 0.1 um}}
""",
    "milk": """\
bakery: 1
name: milk
wavelengths: [0.61, 0.465]
tolerance: 10%
medium: {albedo: [0.98, 0.9], mean_free_path: 1 mm, phase: {type: hg, g: 0.3}}
multiple_scattering: {sources: [point, segment], tolerance: 10%}
beam: {photons: 20000}
surface: {thickness: 1 mm, boundary: {index: 1.3, roughness: 0.3}, base: {albedo: 0.5}}
""",
    "sand": """\
bakery: 1
name: sand
wavelengths: [0.61, 0.465]
tolerance: 10%
grains:
  radius: 0.25 mm
  components:
    - {name: rock, weight: 0.5, shape: {type: rock, seed: 3}, surface: {type: dielectric, material: quartz}}
    - {name: ball, weight: 0.5, shape: {type: sphere}, surface: {type: diffuse, reflectance: 0.5}}
packing: {fraction: 0.5, count: 60, radii: {distribution: lognormal, sigma: 1.1}}
scatterometer: {tolerance: 10%, triangles: coarse}
effective_medium: {walks: 100000}
""",
    "tiles": "bakery: 1\nname: tiles\ntolerance: 10%\npacking: {fraction: [0.2, 0.4], count: 40}\n",
}

MORE = RECIPES | {  # apart: another asset among those above would make others of all numbers
    "spray": """\
bakery: 1
name: spray
wavelengths: [0.61, 0.465]
tolerance: 10%
particles:
  number_density: 4e8 /m^3
  components: [{name: water, material: water, size: {distribution: single, radius: 40 um}}]
discrete: {count: 500, box: [10 mm, 10 mm, 10 mm], method: stored}
""",
    "sheet": RECIPES["sand"].replace("sand", "sheet") + "surface: {thickness: 2 mm, tolerance: 30%}\n",
}
WORLD = """<scene version="3.0.0"><sensor type="perspective"><float name="fov" value="34"/><transform name="to_world">
<lookat origin="0, -30, 8" target="0, 0, 0" up="0, 0, 1"/></transform></sensor>BODY<emitter type="constant"/></scene>"""
BODY = '<shape type="cube" id="body"><transform name="to_world"><scale value="3"/></transform><bsdf type="null"/></shape>'
# an entry of a scene -> methods that render it
ENTRIES = {
    "where: {shape: body}, as: body": ("paths", "shells", "vrl+tables", "beams+tables", "metropolis+tables", "dipole", "surface"),
    "where: {mesh: heap.ply, unit: 1 mm}, as: grains": ("ept", "vpt", "ept+vpt", "ept+vpt+da", "teleport"),
    "where: {box: {lo: [-5, -5, -5] mm, hi: [5, 5, 5] mm}}, as: particles": ("particles", "continuous", "query", "explicit"),
}


def baked(folder: Path, recipes=RECIPES) -> dict[str, Path]:
    """The sound assets."""
    import bakery

    found = {}
    for name, recipe in recipes.items():
        (folder / f"{name}.yaml").write_text(recipe)
        found[name] = Path(bakery.bake(folder / f"{name}.yaml", folder / f"{name}.h5"))
    return found


# ---- changes


def changed(root: Group, draw: random.Random) -> tuple[Group, str]:
    """The tree with one to three changes, and what they are."""
    said = []
    for _ in range(draw.choice((1, 1, 1, 2, 3))):
        path, member = draw.choice([(path, member) for path, member in root.walk() if not path.startswith("provenance/")
                                    or draw.random() < 0.3])
        change = draw.choice((SHAPES, TYPES_, VALUES, VALUES, VALUES, PLACES, TEXTS_ if isinstance(member, Dataset)
                              and member.units == "utf-8" else ATTRIBUTES))
        root, words = change(root, path, member, draw)
        said.append(f"{path}: {words}")
    return root, "; ".join(said)


def SHAPES(root, path, member, draw):
    if not isinstance(member, Dataset):
        return ATTRIBUTES(root, path, member, draw)
    data = member.data
    ways = {"transposed": lambda: data.T, "a row less": lambda: data[:-1],
            "a row more": lambda: np.concatenate([data, data[-1:]]),
            "flat": lambda: data.reshape(-1), "one axis more": lambda: data[..., None], "one axis in front": lambda: data[None],
            "empty": lambda: data[:0], "one number": lambda: data.reshape(-1)[:1],
            "a row": lambda: data[0] if data.ndim > 1 else data, "twice": lambda: np.concatenate([data, data]),
            "a column less": lambda: data[..., :-1],
            "huge": lambda: np.broadcast_to(data.reshape(-1)[:1], (draw.choice((70_000, 2_000_000)),) + data.shape[1:])
            if data[:1].size < 4 else data[:0],
            "eight axes": lambda: data.reshape(data.shape + (1,) * (8 - data.ndim))}
    way = draw.choice(list(ways))
    return with_member(root, path, replace(member, data=np.ascontiguousarray(ways[way]()) if data.size else np.zeros(3))), way


def TYPES_(root, path, member, draw):
    if not isinstance(member, Dataset):
        return ATTRIBUTES(root, path, member, draw)
    kind = draw.choice(TYPES)
    with np.errstate(all="ignore"):
        data = member.data.astype(kind)
    return with_member(root, path, replace(member, data=data, choices=())), f"as {kind}"


def VALUES(root, path, member, draw):
    if not isinstance(member, Dataset) or not member.data.size:
        return ATTRIBUTES(root, path, member, draw)
    data = member.data.copy()
    way = draw.choice(("one", "all", "row", "times", "times", "reversed", "shuffled", "constant", "jump"))
    flat = data.reshape(-1)
    if way == "times":
        factor = draw.choice(FACTORS)
        with np.errstate(all="ignore"):
            data, way = (data.astype(float) * factor).astype(data.dtype), f"times {factor:g}"
    elif way == "reversed":
        data = data[::-1]
    elif way == "shuffled":
        draw.shuffle(flat)
    elif way == "constant":
        flat[:] = flat[draw.randrange(flat.size)]
    else:
        with np.errstate(all="ignore"):  # out of range: whatever the machine makes of it
            value = np.asarray(draw.choice(NUMBERS)).astype(data.dtype)
        at = draw.randrange(flat.size)
        place = {"one": slice(at, at + 1), "all": slice(None), "row": slice(0, data.shape[-1]), "jump": slice(at, None)}[way]
        flat[place] = value
        way = f"{way} {value}"
    return with_member(root, path, replace(member, data=np.ascontiguousarray(data))), way


def PLACES(root, path, member, draw):
    others = [name for name, _ in root.walk()]
    way = draw.choice(("gone", "gone", "renamed", "again", "elsewhere", "swapped", "a group", "a dataset"))
    parent = path.rpartition("/")[0]
    if way == "gone":
        return with_member(root, path, None), way
    if way == "a group":
        return with_member(root, path, Group({"phase": member}, {"stage": "medium"})), way
    if way == "a dataset":
        return with_member(root, path, Dataset(np.zeros(3), "1", "was something else")), way
    if way == "swapped":
        other = draw.choice(others)
        return with_member(root, path, root[other]), f"now {other}"
    name = draw.choice(("phase", "radius", "w7", "sigma_q_error", "x" * 64, "centers"))
    target = draw.choice([n for n, m in root.walk() if isinstance(m, Group)]) if way == "elsewhere" else parent
    if way != "again":
        root = with_member(root, path, None)
    with contextlib.suppress(KeyError):
        root = with_member(root, f"{target}/{name}" if target else name, member)
    return root, f"{way} {target}/{name}"


def TEXTS_(root, path, member, draw):
    content = draw.choice(TEXTS)
    return with_member(root, path, replace(member, data=np.frombuffer(content, np.uint8))), f"text {content[:20]!r}"


def ATTRIBUTES(root, path, member, draw):
    if isinstance(member, Dataset):
        key = draw.choice(("units", "description", "choices"))
        value = draw.choice((("a", "b"), (), ("mie",))) if key == "choices" and member.data.dtype.kind in "iu" else \
            draw.choice(("", "1", "um", "rad", "1/sr", "utf-8", "\x1b[2J", "µ" * 400, "a\nb", "$x^{", "<script>"))
        key = key if isinstance(value, str) == (key != "choices") else "units"
        return with_member(root, path, replace(member, **{key: value})), f"{key} {value!r:.30}"
    key = draw.choice([*member.attributes, "tolerance", "achieved_error", "stage_version", "seconds", "workers", "stage"])
    value = draw.choice((None, "", "text", "a\nb\x1b", 0, -1, 2**62, 1e308, -1.0, float("nan"), float("inf"), True))
    attributes = {k: v for k, v in member.attributes.items() if k != key} | ({} if value is None else {key: value})
    return with_member(root, path, Group(member.members, attributes)), f"attribute {key} = {value!r}"


# ---- commands


def commands(path: Path, sound: Path, root: Group, folder: Path, draw: random.Random) -> list[list[str]]:
    """Calls of every command that reads an asset."""
    paths = [name for name, _ in root.walk()]
    arguments = draw.choice(([], ["wavelength=0.55um"], ["theta=10deg"], ["wavelength=0.5um", "theta=[0, 90] deg"],
                             ["radius=0.5um"], ["rho=1", "z=2", "theta=30deg"]))
    asked = draw.choices([*paths, "multiple/point", "multiple/segment", "medium/phase", "medium/achieved_error"], k=3)
    calls = [["inspect", path], ["inspect", path, "--json"], ["inspect", path, draw.choice(paths)],
             ["plot", path, "-o", folder / "plots"], ["report", path, "-o", folder / "page.html", "--no-render"],
             *(["query", path, one, *arguments, *draw.choice(([], ["--json"]))] for one in asked),
             *(["export", path, "--to", form, "-o", folder / form] for form in ("csv", "hg", "mitsuba", "ply", "obj", "xyz")),
             ["diff", path, sound], ["diff", sound, path, "--json", "--rtol", "0.01"]]
    return [[str(word) for word in call] for call in calls]


def scenes(path: Path, folder: Path) -> dict[str, list[str]]:
    """Calls that render the asset as everything that it may be, 8 x 8 pixels, by the name of their scenes."""
    from bakery.physics.shapes.radial import icosphere
    from bakery.store import ply

    vertices, faces = icosphere(80)
    (folder / "heap.ply").write_bytes(ply.mesh(9 * vertices, faces))
    calls = {}
    for entry, methods in ENTRIES.items():
        kind = entry.rpartition(" ")[2]
        (folder / f"{kind}.xml").write_text(WORLD.replace("BODY", BODY if kind == "body" else ""))
        for method in methods:
            scene = folder / f"{kind}-{method}.yaml"
            scene.write_text(f"bakery_scene: 2\nname: s\nscene: {{mitsuba: {kind}.xml, unit: 1 mm}}\ndenoise: no\n"
                             "film: {width: 8, height: 8}\nstop: {samples: 1}\n"
                             f"materials:\n  - {{{entry}, asset: {path}, method: {method}}}\n")
            calls[scene.stem] = ["render", str(scene), "-o", str(folder / "picture.png"), "--quality", "draft"]
    return calls


@contextlib.contextmanager
def sketched():
    """Pictures are laid out and drawn, but coarsely and into no file: writing PNG and SVG takes most of the time of `plot`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from bakery.draw import picture as figures

    def sketch(figure, forms):
        figure.set_dpi(20)
        FigureCanvasAgg(figure).draw()
        return dict.fromkeys(forms, b"sketch")

    whole, figures.saved = figures.saved, sketch
    try:
        yield
    finally:
        figures.saved = whole


class TooLong(BaseException):
    """A command has not ended in its time."""


def _stop(*_):
    raise TooLong


def ran(call: list[str]) -> tuple[int, str]:
    """Status and what is wrong with the way in which a command ended, or nothing."""
    out, err = io.StringIO(), io.StringIO()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    signal.signal(signal.SIGPROF, _stop)
    limit = DRAWING if call[0] in ("plot", "report", "render") else TIME
    signal.setitimer(signal.ITIMER_PROF, limit)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # values may be nonsense, and what is computed from them as well
            status = status_of(call)
    except TooLong:
        return -1, f"did not end within {limit} s\n{traceback.format_exc()}"
    except Exception:
        return -1, traceback.format_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
    lines = [line for line in err.getvalue().splitlines() if not line.endswith(" so far")]  # a busy machine
    lines = lines[:1] if lines[-1:] and lines[-1].strip() == "^" else lines  # what is wrong with a scene, and where
    if status not in (0, 1, 2, 3):
        return status, f"ended with status {status}"
    if grown > MEMORY:
        return status, f"took {grown / 1e6:.0f} MB more than before"
    if status > 1 and (len(lines) != 1 or "out of memory" in lines[0]):
        return status, f"status {status} with {len(lines)} lines: {err.getvalue()[:600]}"
    return status, ""


def verified(path: Path) -> str:
    """What is wrong with the way in which `verify` ends, in this process, or nothing."""
    from bakery.asset.verify import _broken
    from bakery.errors import AssetError

    signal.signal(signal.SIGPROF, _stop)
    signal.setitimer(signal.ITIMER_PROF, TIME)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            broken = _broken(str(path))
    except AssetError:
        return ""
    except (Exception, TooLong):
        return traceback.format_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return "".join(line for line in broken if "cannot be checked" in line)


def one(number: int, sound: dict[str, Path], folder: Path, every: bool = False,
        seed: int = 0) -> tuple[str, list[tuple[str, str]]]:
    """Makes the asset with a number and gives it to commands: what was changed, and (call, fault) of each that failed."""
    draw = random.Random(f"{seed} {number}")
    of = sound[draw.choice(sorted(sound))]
    root = read(of)
    try:
        root, said = changed(root, draw)
        path = folder / f"case{number}.h5"
        write(path, root)
    except (ValueError, KeyError, RecursionError) as error:  # what the store itself refuses to write
        return f"not written: {error}", []
    failed, calls = [], commands(path, of, root, folder, draw)
    if not every:
        status, fault = ran(calls[0])
        drawing = [call for call in calls if call[0] in ("plot", "report")]  # seconds each
        calls = draw.sample(calls, 4 if status == 0 else 1)  # refused by one, refused by all
        if status == 0 and draw.random() < 0.8:
            calls = [call for call in calls if call not in drawing]
        failed += [("inspect", fault)] * bool(fault)
    failed += [(" ".join(call), fault) for call in calls if (fault := ran(call)[1])]
    if fault := verified(path):
        failed.append((f"verify {path}", fault))
    path.unlink()
    return f"{of.stem}: {said}", failed


def without_members(sound: dict[str, Path], folder: Path) -> int:
    """Each asset without each of its members in turn, as far as the check at opening lets it pass: the number of failures."""
    failures = 0
    for name, of in sound.items():
        path, whole = folder / "lacking.h5", read(of)
        path.write_bytes(of.read_bytes())
        renders = {scene: call for scene, call in scenes(path, folder).items() if ran(call)[0] in (0, 3)}
        for gone, _ in whole.walk():
            root = with_member(whole, gone, None)
            if gone.startswith("provenance/") or declared(root):
                continue
            write(path, root)
            calls = [call + ["--overwrite"] * (call[0] in ("plot", "export"))  # sketches are no pictures
                     for call in commands(path, of, root, folder, random.Random(gone))] + list(renders.values())
            failed = [(" ".join(call), fault) for call in calls if (fault := ran(call)[1])]
            failed += [(f"verify {path}", fault)] if (fault := verified(path)) else []
            failures += len(failed)
            print(f"{name} without {gone}: {len(calls)} calls, {len(failed)} failures", flush=True)
            for call, fault in failed:
                print(f"{call}\n{fault}\n", flush=True)
    return failures


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, default=None)
    parser.add_argument("--members", action="store_true")
    asked = parser.parse_args()
    failures = number = 0
    with tempfile.TemporaryDirectory(prefix="fuzz") as kept, sketched():
        folder = Path(kept)
        sound = baked(folder, MORE if asked.members else RECIPES)
        if asked.members:
            return int(without_members(sound, folder) > 0)
        until = time.monotonic() + asked.seconds
        while time.monotonic() < until if asked.only is None else number == 0:
            said, failed = one(number if asked.only is None else asked.only, sound, folder, asked.only is not None, asked.seed)
            for call, fault in failed:
                failures += 1
                print(f"case {number}: {said}\n{call}\n{fault}\n", flush=True)
            number += 1
    print(f"{number} assets, {failures} failures")
    return int(failures > 0)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory(prefix="cache") as kept:
        os.environ.setdefault("BAKERY_CACHE", kept)
        sys.exit(main())
