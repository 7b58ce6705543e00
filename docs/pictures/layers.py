"""Draws docs/pictures/layers.png: the layers that tests/unit/test_imports.py keeps.  Run: python docs/pictures/layers.py"""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

INK, QUIET, FAINT = "#1c2530", "#5d6875", "#eef1f4"
# rows from the top: (name, what it holds)
ROWS = (
    (("cli", "one file a command"),),
    (("run", "workers, cache, progress"), ("trade", "error against time"), ("report", "the page"), ("export", "other software")),
    (("plan", "stages, reasons, costs"), ("asset", "open, verify, compare")),
    (("recipe", "sections put together"),),
    (("family", "what is swept, and what is between"),),
    (("stages/NAME", "section · stage · view · pictures · measures"),),
    (("grammar", "YAML, units, problems"), ("physics", "arrays in, arrays out"), ("draw", "how pictures look"),
     ("store", "HDF5, hashes, checks")),
    (("system", "LLVM, memory, threads"), ("rng", "every random stream"), ("errors", "")),
)
WIDTH, HEIGHT, GAP = 10.0, 0.78, 0.34


def box(axes, x, y, width, name, content, face=FAINT):
    axes.add_patch(FancyBboxPatch(
        (x, y), width, HEIGHT, boxstyle="round,pad=0.02,rounding_size=0.08", facecolor=face, edgecolor=QUIET, linewidth=0.8))
    axes.text(x + width / 2, y + HEIGHT * (0.64 if content else 0.5), name, ha="center", va="center", color=INK, fontsize=11,
              fontweight="bold", family="monospace")
    axes.text(x + width / 2, y + HEIGHT * 0.28, content, ha="center", va="center", color=QUIET, fontsize=8.5)


figure = Figure(figsize=(11, 7.6))
axes = figure.add_axes((0, 0, 1, 1))
axes.set(xlim=(-0.3, WIDTH + 3.4), ylim=(-0.4, len(ROWS) * (HEIGHT + GAP)))
axes.axis("off")
for row, boxes in enumerate(reversed(ROWS)):
    y, width = row * (HEIGHT + GAP), WIDTH / len(boxes)
    for k, (name, content) in enumerate(boxes):
        box(axes, k * width + 0.06, y, width - 0.12, name, content)
    if row:
        axes.annotate("", (WIDTH / 2, y - GAP + 0.03), (WIDTH / 2, y - 0.03),
                      arrowprops={"arrowstyle": "-|>", "color": QUIET, "linewidth": 1.2})
axes.text(WIDTH / 2 + 0.2, HEIGHT + GAP / 2 - 0.02, "imports point down", color=QUIET, fontsize=8.5, va="center")
# renderers beside the layers: the three modules that they import
box(axes, WIDTH + 0.9, 3 * (HEIGHT + GAP), 2.2, "renderers", "assets in, pictures out", "#fdf0e6")
for row in (5, 1):
    low = row * (HEIGHT + GAP) + HEIGHT / 2
    axes.annotate("", (WIDTH, low), (WIDTH + 0.9, 3 * (HEIGHT + GAP) + HEIGHT / 2),
                  arrowprops={"arrowstyle": "-|>", "color": "#b3541e", "linewidth": 1.2})
axes.text(WIDTH + 0.62, 4.55 * (HEIGHT + GAP), "bakery.open", color="#b3541e", fontsize=9, family="monospace")
axes.text(WIDTH + 0.72, 1.75 * (HEIGHT + GAP), "bakery.kernels\nbakery.grammar", color="#b3541e", fontsize=9, family="monospace")
figure.savefig(Path(__file__).with_suffix(".png"), dpi=110, facecolor="white", metadata={"Software": None})
