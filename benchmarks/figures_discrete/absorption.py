"""Fig. 18: particles that absorb scatter less."""

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized

from . import stand

COUNT, RADIUS = sized(20_000, 500), 100.0  # um
ABSORPTION = sized((0.0, 1e-5, 1e-4, 1e-3, 1e-2), (0.0, 1e-2))


def measure():
    made = {k: stand.asset(stand.single(RADIUS), COUNT, f"{{n: 1.5, k: {k:g}}}") for k in ABSORPTION}
    return {k: stand.picture(asset, "particles", 4) for k, asset in made.items()}


def tables(numbers):
    clear, x = numbers[0.0], of.size_parameter(RADIUS) * 0.6 / 0.55
    body = [[of.short(k), of.short(4 * x * k), f"{found.single.mean() / clear.single.mean():.3f}",
             f"{found.all.mean() / clear.all.mean():.3f}"] for k, found in numbers.items()]
    head = ["k", "4 x k, optical depth of a diameter", "single scattering over that at k = 0", "all orders"]
    return {"fig18": of.table(head, body)}


def draw(numbers):
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(numbers), figsize=(9, 2.1), layout="constrained")
    white = 4 * numbers[0.0].all.mean()
    for (k, found), ax in zip(numbers.items(), axes):
        ax.imshow((found.all / white).clip(0, 1) ** 0.45, cmap="gray", vmin=0, vmax=1)
        ax.set(xticks=[], yticks=[], title=f"k = {k:g}")
    return figure
