"""Figs. 24, 25, 28: longer and shorter mean free paths of a ball of index 1.5 under a panel and a sky."""

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized

from . import stand

# albedo, or that of red, green, blue, and g
MEDIA = {"bumpy sphere": ((0.955, 0.677, 0.457), 0.9), "of fig. 28": ((0.24, 0.48, 0.96), 0.3),
         "albedo 0.995, g = 0": (2 / 2.01, 0.0)}
RADII = sized((2.5, 10.0, 40.0), (2.5,))  # mean free paths
MEDIA = dict(list(MEDIA.items())[::sized(1, -3)])
SECONDS = {"paths": 16.0}
OTHERS = 8.0


def methods():
    return [name for name in stand.every_method() if ", " not in name and name != "dipole"]


def measure(size, share):
    """By medium and radius: share of light that scattered three times and more, and findings of it by method."""
    numbers = {"size": size, "share": share}
    for name, (albedo, g) in MEDIA.items():
        plain = stand.ball(stand.medium(albedo, g), 1.5, size)
        for radius in RADII:
            how = stand.thicker(plain, radius)
            runs = {method: stand.Run(how, method) for method in methods()}
            stand.together(runs, {method: share * SECONDS.get(method, OTHERS) for method in runs})
            paths = runs["paths"]
            numbers[name, radius] = (paths.found(stand.LATER).total / paths.found(stand.SCATTERED).total,
                                     {method: run.found(stand.LATER) for method, run in runs.items()})
    return numbers


def tables(numbers):
    body = []
    for name in MEDIA:
        for radius in RADII:
            later, by = numbers[name, radius]
            reference = by["paths"]
            body.append([name, f"{radius:g}", f"{later:.2f}", stand.of_seconds(reference.seconds),
                         *(f"{stand.of_seconds(by[method].seconds)} s; {stand.over(*stand.ratio(by[method], reference), 2)}"
                           for method in methods()[1:])])
    head = ["medium", "radius, mean free paths", "share of three and more events", "`paths`: noise 1 % after, s",
            *(f"`{method}`; over `paths`" for method in methods()[1:])]
    times = SECONDS | {"others": OTHERS}
    return {"fig25": of.table(head, body) + "\n\n" + stand.conditions(numbers["size"], times, numbers["share"])}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(MEDIA) + 1, figsize=(11, 3), layout="constrained")
    for ax in axes:
        ax.set(xscale="log", xlabel="radius, mean free paths")
        ax.set_xticks(RADII, [f"{radius:g}" for radius in RADII])
        ax.minorticks_off()
    for name, ax in zip(MEDIA, axes):
        for method in methods():
            ax.plot(RADII, [numbers[name, radius][1][method].seconds for radius in RADII], "o-", label=method)
        ax.set(yscale="log", title=name)
        axes[-1].plot(RADII, [numbers[name, radius][0] for radius in RADII], "o-", label=name)
    axes[0].set_ylabel("noise 1 % after, s")
    axes[0].legend(fontsize=6)
    axes[-1].set(title="share of events ≥ 3", ylim=(0, 1))
    axes[-1].legend(fontsize=6)
    return figure
