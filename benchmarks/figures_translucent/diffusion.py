"""Figs. 20, 21: pictures by diffusion and by tables where light scatters evenly, and where it scatters far forward."""

from benchmarks.figures_goa import measures as of

from . import stand

MEDIA = {"g = 0, albedo 0.995": (2 / 2.01, 0.0), "g = 0.9, albedo 0.955": (0.955, 0.9)}
RADIUS = 10.0  # mean free paths
SECONDS = {"paths": 60.0, "vrl+tables": 20.0, "vrl+tables, none": 10.0, "dipole": 15.0}


def measure(size, share):
    """By medium and method: light of two and more events from a ball of index 1.5 under a panel and a sky."""
    numbers = {"size": size, "share": share}
    for name, (albedo, g) in MEDIA.items():
        how = stand.thicker(stand.ball(stand.medium(albedo, g), 1.5, size), RADIUS)
        runs = {method: stand.Run(how, method) for method in SECONDS}
        stand.together(runs, {method: share * seconds for method, seconds in SECONDS.items()})
        numbers[name] = {method: run.found(stand.SECOND) for method, run in runs.items()}
    return numbers


def tables(numbers):
    body = []
    for name in MEDIA:
        by = numbers[name]
        for method in list(SECONDS)[1:]:
            body.append([name, f"`{method}`", stand.over(*stand.ratio(by[method], by["paths"])),
                         stand.of_bias(*stand.bias(by[method], by["paths"])), stand.of_seconds(by[method].seconds),
                         stand.of_seconds(by["paths"].seconds)])
    head = ["medium", "method", "two and more events over `paths`", "bias, %", "noise 1 % after, s", "`paths`, s"]
    return {"fig20": of.table(head, body) + "\n\n" + stand.conditions(numbers["size"], SECONDS, numbers["share"])}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(MEDIA), len(SECONDS), figsize=(8, 4.4), layout="constrained")
    for name, row in zip(MEDIA, axes):
        by = numbers[name]
        for method, ax in zip(SECONDS, row):
            ax.imshow(stand.shown(by[method].image, 3 * by["paths"].total))
            ax.set(xticks=[], yticks=[], title=method)
            ax.grid(False)
        row[0].set_ylabel(name.replace(", ", ",\n"), fontsize=7)
    return figure
