"""Draws docs/pictures/theta.png: the scattering angle.  Run from the repository's root: python docs/pictures/theta.py"""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

INK, LIGHT, LOBE = "#222222", "#888888", "#e08a2e"
figure, axes = plt.subplots(figsize=(6.4, 2.9), dpi=130)
g, turn = 0.6, np.linspace(0, 2 * np.pi, 400)
lobe = 0.28 * (1 - g**2) / (1 + g**2 - 2 * g * np.cos(turn)) ** 1.5
axes.fill(lobe * np.cos(turn), lobe * np.sin(turn), color=LOBE, alpha=0.3, lw=0)
axes.plot(lobe * np.cos(turn), lobe * np.sin(turn), color=LOBE, lw=1)
theta = np.radians(38)
arrow = {"arrowstyle": "-|>", "color": INK, "lw": 1.8, "shrinkA": 0, "shrinkB": 0}
axes.annotate("", (0, 0), (-2.2, 0), arrowprops=arrow)
axes.annotate("", (2 * np.cos(theta), 2 * np.sin(theta)), (0, 0), arrowprops=arrow)
axes.plot([0, 2.6], [0, 0], color=LIGHT, lw=1, ls=(0, (5, 4)))
arc = np.linspace(0, theta, 60)
axes.plot(1.25 * np.cos(arc), 1.25 * np.sin(arc), color=INK, lw=1.2)
axes.text(1.36 * np.cos(theta / 2), 1.36 * np.sin(theta / 2) - 0.05, r"$\theta$", size=14, color=INK)
axes.plot(0, 0, "o", color=INK, ms=5)
axes.text(-2.2, 0.1, "direction of travel before", color=INK, size=9)
axes.text(1.62, 1.12, "after", color=INK, size=9)
axes.text(2.62, -0.04, r"$\theta = 0$, forward", color=LIGHT, size=9)
axes.text(-0.62, -0.42, "phase function", color=LOBE, size=9, ha="right")
axes.set_aspect("equal")
axes.set_xlim(-2.4, 3.8)
axes.set_ylim(-0.75, 1.5)
axes.axis("off")
figure.savefig(Path(__file__).with_suffix(".png"), bbox_inches="tight")
