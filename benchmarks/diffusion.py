"""What diffusion costs, saves and gets wrong in the medium of a mesh, against the same paths without it.

    python benchmarks/diffusion.py                   processor time, without compilation; some minutes

First table: mean radiance of pictures that bodies fill, sky above them and none below; how far off it is with
`Continuous(diffuse=True)`, and the standard error of that; how far off where light diffuses from d_DA on, which is
min(1/sigma_t', 0.5/sigma_tr) (Meng et al. 2015); processor time of a path; variance of a pixel, with over without.  Lengths in
1/sigma_t'.

Then a lossless ball in light from everywhere, of which exactly 1 is to be seen.

Last table: light of an isotropic source in a ball of radius 10/sigma_t', isotropic scattering: the share that gets out, and the
mean height (over the radius) where it does, by random walks; and off by how much the spheres are, and appendix A of that paper:
multipoles (net flux) of slabs through the first intersections along random directions.  Appendix A as it stands, and so that
lossless light is conserved: shares over those without absorption.
"""

import argparse
import time

import numpy as np

from bakery.physics.granular.diffusion import decay
from bakery.physics.shapes.radial import icosphere
from benchmarks.sizes import sized
from renderers.materials.grains import medium
from tests.oracles.diffusion import JENSEN, exitance, improved
from tests.physics.particles import Sky, camera
from tests.physics.test_aggregate import CUBE
from tests.physics.test_granular_medium import continuous
from tests.physics.test_granular_render import COLOURS, NOTHING, passes

SIZE, RADIUS = sized(64, 4), 10.0
PASSES, WALKS = sized((24, 8, 4), (2, 2, 2)), sized(100_000, 1000)


def ball(radius):
    vertices, faces = icosphere(1280)
    return radius * vertices, faces


def box(half):
    return (2 * CUBE[0] - 1) * half, CUBE[1]


def seen(how, mesh, count, below=0):
    """Mean radiance, its error, variance of a pixel, seconds a path; sky of 1 above and of `below` elsewhere."""
    far = 5 * np.abs(mesh[0]).max()
    view, sky = camera((SIZE, SIZE), (0.0, -far, 0.4 * far), (0.0, 0.0, 0.0), 16), Sky(above=1, below=below)
    passes(sky, how, view, (SIZE, SIZE), [0])
    begin = time.process_time()
    found = passes(sky, how, view, (SIZE, SIZE), range(count))[..., 0]
    spent = (time.process_time() - begin) / found.size
    variance = found.var(axis=0, ddof=1).mean()
    return found.mean(), np.sqrt(variance / found.size), variance, spent


def row(name, mesh, albedo, g, count):
    sigma_t = 1 / (1 - albedo * g)
    plain = continuous(sigma_t, albedo, g, mesh=mesh)
    ours, theirs = (medium.Continuous(plain.medium, NOTHING, COLOURS, diffuse=True) for _ in range(2))
    tr = ours.diffuse.sigma_tr[0]
    theirs.diffuse = ours.diffuse._replace(near=min(1.0, 0.5 / tr) if tr > 0 else 1.0, skin=0.0)
    a, b, c = (seen(how, mesh, count) for how in (plain, ours, theirs))
    return (f"{name} | {albedo} | {g} | {a[0]:.4f} | {100 * (b[0] / a[0] - 1):+.2f} | {100 * np.hypot(a[1], b[1]) / a[0]:.2f} | "
            f"{100 * (c[0] / a[0] - 1):+.2f} | {1e6 * a[3]:.0f} | {1e6 * b[3]:.0f} | {b[2] / a[2]:.2f}")


def white(mesh, count):
    """What is seen of a lossless body in light of 1 from everywhere, without and with diffusion, and errors."""
    plain = continuous(1.0, 1.0, mesh=mesh)
    both = plain, medium.Continuous(plain.medium, NOTHING, COLOURS, diffuse=True)
    return tuple(figure for how in both for figure in seen(how, mesh, count, below=1)[:2])


def directions(random, n):
    d = random.normal(size=(n, 3))
    return d / np.linalg.norm(d, axis=1)[:, None]


def way_out(place, d):
    """Distances to the ball."""
    along = np.sum(place * d, axis=1)
    return np.sqrt(along**2 + RADIUS**2 - np.sum(place**2, axis=1)) - along


def walked(place, albedo):
    """Weights and places (n, 3) of random walks from places (n, 3) where they get out."""
    random, n = np.random.default_rng(1), len(place)
    weight, left, place = np.ones(n), np.arange(n), place.copy()
    while len(left):
        d = directions(random, len(left))
        t, out = random.exponential(size=len(left)), way_out(place[left], d)
        place[left] += np.minimum(t, out)[:, None] * d
        left = left[t < out]
        weight[left] *= albedo
    return weight, place


def spheres(place, albedo):
    """As `walked`, spheres first."""
    random, k = np.random.default_rng(2), decay(albedo, np.eye(1, 64)[0])
    weight, place = np.ones(len(place)), place.copy()
    while len(inside := np.flatnonzero(RADIUS - np.linalg.norm(place, axis=1) > 1.5)):
        radius = RADIUS - np.linalg.norm(place[inside], axis=1) - 0.5
        weight[inside] *= k * radius / np.sinh(k * radius) if k > 0 else 1.0
        place[inside] += radius[:, None] * directions(random, len(inside))
    later, place = walked(place, albedo)
    return weight * later, place


def multipoles(place, albedo):
    """Appendix A: weights where directions meet the ball, at the albedo and lossless, and these places."""
    d = directions(np.random.default_rng(3), len(place))
    ahead, behind = way_out(place, d), way_out(place, -d)
    out = place + ahead[:, None] * d
    cosine = np.sum(out * d, axis=1) / RADIUS  # the same at both ends of a chord
    depth, thickness = ahead * cosine, (ahead + behind) * cosine
    across = ahead * np.sqrt(np.maximum(1 - cosine**2, 0))

    def weight(albedo):
        one = improved(np.full(1, albedo), np.full(1, 1 - albedo), 0.0)
        return 4 * np.pi * ahead**2 / cosine * exitance(one, across, depth, thickness, law=JENSEN)

    return weight(albedo), weight(1.0), out


def point_row(albedo, depth, n):
    place = np.tile([0.0, 0.0, RADIUS - depth], (n, 1))
    found = [(weight.mean(), np.average(out[:, 2], weights=weight) / RADIUS)
             for weight, out in (walked(place, albedo), spheres(place, albedo))]
    plain, lossless, out = multipoles(place[: n // 10], albedo)
    height = np.average(out[:, 2], weights=plain) / RADIUS
    found += [(plain.mean(), height), (plain.mean() / lossless.mean(), height)]
    (share, high), *others = found
    return f"{albedo} | {depth} | {share:.4f} | {high:.3f} | " + " | ".join(
        f"{100 * (a / share - 1):+.1f} | {b - high:+.3f}" for a, b in others)


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    print("| body | albedo | g | radiance | off, % | error, % | from d_DA on, % | without, us | with, us | variance |")
    print("|---" * 10 + "|")
    many, some, few = PASSES
    bodies = [("ball, 10", ball(10.0), albedo, g, many) for g in (0.0, 0.65) for albedo in (1.0, 0.999, 0.99, 0.9)]
    flat = box([20.0, 20.0, 3.0])
    bodies += [("box, 40 x 40 x 6", flat, albedo, g, many) for albedo, g in ((1.0, 0.0), (0.99, 0.65), (0.9, 0.65))]
    bodies += [("box, 2 x 2 x 2", box([1.0, 1.0, 1.0]), 1.0, 0.0, few)]
    bodies += sized([("ball, 200", ball(200.0), 1.0, 0.0, some)], [])
    for one in bodies:
        print("| " + row(*one) + " |", flush=True)
    wide = sized(200.0, 5.0)
    print(f"\nball, {wide:g}, lossless, light from everywhere: "
          "{:.4f} +- {:.4f} without, {:.4f} +- {:.4f} with".format(*white(ball(wide), many)))
    print("\n| albedo | depth | gets out | height | spheres, % | height | appendix A, % | height | normalised, % | height |")
    print("|---" * 10 + "|")
    for albedo in (1.0, 0.99, 0.9):
        for depth in (2.0, 4.0):
            print("| " + point_row(albedo, depth, WALKS) + " |", flush=True)


if __name__ == "__main__":
    main()
