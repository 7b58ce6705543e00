"""Meshes by our own code against libraries that could do the same: python benchmarks/meshes.py [PART …]

Where our own code stays (docs/grain-shapes.md), this is the reason: what trimesh's readers do with files of 200,000 triangles and
with hostile ones, each in a child process that may take 4 GiB and 60 s; fewer triangles by pymeshlab and fast-simplification; the
smallest ball by trimesh; a picture by matplotlib.  CPU seconds of one core; ours are those after compiling.
"""

import io
import resource
import subprocess
import sys
import time
import tracemalloc
import warnings
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

import numpy as np  # noqa: E402
from peers import optional  # noqa: E402

from bakery.physics.shapes import build as shapes  # noqa: E402
from bakery.physics.shapes import files  # noqa: E402
from bakery.physics.shapes.quality import volume  # noqa: E402
from benchmarks.sizes import sized  # noqa: E402
from tests.grain_examples import EXAMPLES  # noqa: E402

PLY = (b"ply\nformat %s 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\nelement face %d\n"
       b"property list uchar int vertex_indices\nend_header\n")
LIMIT, SECONDS = 4 << 30, 60  # of a child
MANY, LONG, OFTEN = sized((200_000, 16 << 20, 100), (2_000, 1 << 14, 2))  # triangles, bytes of hostile files, torn grains


def main(parts):
    for name in parts or PARTS:
        print(f"\n{name}: {PARTS[name].__doc__}")
        PARTS[name]()


def timed(job, rounds=3):
    """Least CPU seconds of a job, after one call to warm up, and what it returns."""
    result, least = job(), np.inf
    for _ in range(rounds):
        start = time.process_time()
        job()
        least = min(least, time.process_time() - start)
    return least, result


# ---- reading


def trimesh_reads(data, kind):
    """Vertices and faces as trimesh's reader gives them; materials off."""
    from trimesh.exchange import obj, off, ply, stl

    reader = {"ply": ply.load_ply, "obj": obj.load_obj, "off": off.load_off, "stl": stl.load_stl}[kind]
    with warnings.catch_warnings(action="ignore"):
        found = reader(io.BytesIO(data), skip_materials=True)
    if "vertices" not in found:
        (found,) = found["geometry"].values()
    return np.asarray(found["vertices"], float), np.asarray(found["faces"])


READERS = {"ours": files.triangles, "trimesh": trimesh_reads}


def read():
    """a rock of 200,000 triangles: seconds and MB of memory beside the file's"""
    import trimesh

    mesh = trimesh.Trimesh(*(lambda g: (g.vertices, g.faces))(shapes.rock(seed=1, triangles=MANY)), process=False)
    data = {kind: mesh.export(file_type=kind) for kind in ("ply", "obj", "stl", "off")}
    data |= {"ply text": trimesh.exchange.ply.export_ply(mesh, encoding="ascii"),
             "stl text": trimesh.exchange.stl.export_stl_ascii(mesh)}
    for name, content in data.items():
        content, row = content.encode() if isinstance(content, str) else content, []
        for program, reader in READERS.items():
            seconds, _ = timed(lambda: reader(content, name[:3]), 2)
            tracemalloc.start()
            reader(content, name[:3])
            row.append(f"{program} {seconds:6.3f} s {tracemalloc.get_traced_memory()[1] / 1e6:5.0f} MB")
            tracemalloc.stop()
        print(f"  {name:9s} {len(content) / 1e6:5.1f} MB   " + "   ".join(row))


def hostile_files(size=LONG):
    """Name -> kind, content, and the volume that it encloses, or None where an error is right."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], "<f4")
    mixed = PLY % (b"binary_little_endian", 5, 5) + np.vstack([corners, [[1, 1, 0]]]).astype("<f4").tobytes()
    for polygon in ((0, 2, 4, 1), (0, 1, 3), (1, 4, 3), (4, 2, 3), (2, 0, 3)):
        mixed += bytes([len(polygon)]) + np.array(polygon, "<i4").tobytes()

    def group(size):
        faces = b"f -4 -2 -3\nf -4 -3 -1\nf -3 -2 -1\nf -4 -1 -2\n"
        return b"".join(b"v %g %g %g\n" % tuple(size * row) for row in corners) + faces

    return {
        "binary ply, a quad among triangles": ("ply", mixed, 1 / 3),
        "obj, two bodies, relative indices": ("obj", group(1) + group(2), 9 / 6),
        "obj, Latin-1 in a comment": ("obj", b"# Gr\xf6\xdfe\n" + group(1), 1 / 6),
        "obj, index 0": ("obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 2 3\n", None),
        "text ply, 16 MiB of empty lines": ("ply", PLY % (b"ascii", 3, 1) + b"\n" * size, None),
        "text ply, 16 MiB of short lines": ("ply", PLY % (b"ascii", 1, size // 2 - 10) + b"1\n" * (size // 2), None),
        "text stl, 16 MiB of solids": ("stl", b"solid vertex 0 0 0\nvertex 0 0 0\nvertex 0 0 1\nendsolid\n" * (size // 60), None),
    }


def hostile():
    """what happens, CPU seconds and peak memory with what Python and NumPy take themselves"""
    for name in hostile_files():
        for program in READERS:
            child = subprocess.run([sys.executable, __file__, "--child", name, program], capture_output=True, text=True)
            print(f"  {name:35s} {program:8s} " + (child.stdout.strip() or f"stopped by the limits (status {child.returncode})"))


def child(name, program):
    resource.setrlimit(resource.RLIMIT_AS, (LIMIT, LIMIT))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    kind, data, right = hostile_files()[name]
    start = time.process_time()
    try:
        vertices, faces = READERS[program](data, kind)
    except (ValueError, LookupError, TypeError, AttributeError, ImportError, MemoryError, OverflowError) as error:
        said = f"{'REFUSED, though sound' if right else 'refused'}: {type(error).__name__}: {str(error)[:90]}"
    else:
        held = volume(vertices, faces)
        said = f"read: {len(faces)} triangles, volume {held:.3f}" + ("" if right and abs(held - right) < 1e-6 else ", WRONG")
    seconds, memory = time.process_time() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{seconds:5.1f} s {memory:5.0f} MiB  {said}")


# ---- the rest


def fewer():
    """an aggregate and a rock of 200,000 triangles: seconds, loss of volume, pairs of triangles that cross"""
    from bakery.physics.shapes.quality import self_crossings, tree
    from bakery.physics.shapes.simplify import simplified

    pymeshlab, fast = optional("pymeshlab"), optional("fast_simplification")

    def by_pymeshlab(vertices, faces, target):
        meshes = pymeshlab.MeshSet()
        meshes.add_mesh(pymeshlab.Mesh(vertices, faces))
        meshes.meshing_decimation_quadric_edge_collapse(targetfacenum=target, preservetopology=True, preservenormal=True)
        return meshes.current_mesh().vertex_matrix(), meshes.current_mesh().face_matrix()

    def by_fast_simplification(vertices, faces, target):
        return fast.simplify(vertices, faces.astype(np.int32), target_count=target)

    programs = {"ours": simplified} | ({"pymeshlab": by_pymeshlab} if pymeshlab else {})
    programs |= {"fast-simplification": by_fast_simplification} if fast else {}
    for name in ("snow", "gravel"):
        grain = shapes.build(EXAMPLES[name], MANY)
        for target in sized((20_000, 1_300), (200,)):
            for program, job in programs.items():
                seconds, (v, f) = timed(lambda: job(np.array(grain.vertices), np.array(grain.faces), target), 1)
                crossing = len(self_crossings(tree(v, f), 1000))
                print(f"  {name:7s} to {target:6,}: {program:19s} {seconds:5.2f} s, {len(f):6,} triangles, volume "
                      f"{volume(v, f) / grain.volume - 1:+.2e}, {crossing} crossings")


def torn():
    """100 rocks each of 80 triangles with one fault: how many are sound as they are, and when pymeshlab has been over them"""
    from bakery.physics.shapes.mending import mended
    from bakery.physics.shapes.repair import repaired

    if optional("pymeshlab") is None:
        return
    grain, rng = shapes.rock(seed=1, triangles=80), np.random.default_rng(0)
    faults = {
        "one to three triangles missing": lambda v, f: (v, np.delete(f, rng.integers(0, 80, rng.integers(1, 4)), 0)),
        "a fin": lambda v, f: (np.vstack([v, rng.normal(size=3)]), np.vstack([f, [*f[rng.integers(80), :2], len(v)]])),
        "a corner moved elsewhere": lambda v, f: (v, np.where((np.arange(f.size) == rng.integers(f.size)).reshape(f.shape),
                                                              rng.integers(len(v)), f)),
        "two walls inside": lambda v, f: (v, np.vstack([f, rng.integers(0, len(v), (2, 3))])),
    }
    for name, fault in faults.items():
        sound = {"as they are": 0, "repaired": 0}
        for _ in range(OFTEN):
            broken = fault(grain.vertices, grain.faces)
            for how in sound:
                try:
                    mended(*(broken if how == "as they are" else repaired(*broken)[:2]))
                    sound[how] += 1
                except ValueError:  # which says why: not asked here
                    continue
        print(f"  {name:32s} " + "   ".join(f"{how} {count}" for how, count in sound.items()))
    grain = shapes.rock(seed=1, triangles=MANY)
    soup = grain.vertices[grain.faces].reshape(-1, 3)
    seconds = [timed(lambda: job(soup, np.arange(len(soup)).reshape(-1, 3)), 1)[0] for job in (mended, repaired)]
    print(f"  200,000 triangles as a soup: judged in {seconds[0]:.1f} s, repaired in {seconds[1]:.1f} s")


def ball():
    """radius over the smallest known less 1, and seconds"""
    from trimesh.nsphere import minimum_nsphere

    from bakery.physics.shapes.bounding import minimum_sphere

    rng = np.random.default_rng(1)
    clouds = {"sand, 20,000 triangles": shapes.build(EXAMPLES["sand"]).vertices, "box": shapes.box().vertices,
              "100 points": rng.normal(size=(100, 3)), "ball, 20,000 triangles": shapes.sphere().vertices}
    for name, points in clouds.items():
        ours, theirs = (timed(lambda: job(points), 1) for job in (minimum_sphere, minimum_nsphere))
        best = min(ours[1][1], theirs[1][1])
        print(f"  {name:24s} ours {ours[1][1] / best - 1:.1e} {ours[0]:.4f} s   "
              f"trimesh {theirs[1][1] / best - 1:.1e} {theirs[0]:.4f} s")


def picture():
    """sand of 20,000 triangles on 500 x 500 pixels, seconds; matplotlib's has neither shadows nor a surface without facets"""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from bakery.draw.meshes import rendered

    grain = shapes.build(EXAMPLES["sand"])

    def theirs():
        figure = Figure((5, 5), dpi=100)
        axes = figure.add_subplot(projection="3d")
        axes.plot_trisurf(*grain.vertices.T, triangles=grain.faces, color="0.7", linewidth=0, antialiased=False)
        FigureCanvasAgg(figure).draw()
        return figure

    ours = timed(lambda: rendered(grain.vertices, grain.faces, np.full(3, 0.7)))[0]
    print(f"  ours {ours:.2f} s, with 14 lights and their shadows   matplotlib {timed(theirs)[0]:.2f} s")


PARTS = {"read": read, "hostile": hostile, "fewer": fewer, "torn": torn, "ball": ball, "picture": picture}

if __name__ == "__main__":
    child(*sys.argv[2:]) if sys.argv[1:2] == ["--child"] else main(sys.argv[1:])
