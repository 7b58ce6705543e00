"""Command line: see the package."""

from benchmarks.claims import command

CLAIMS = {  # name on the command line: (module, picture)
    "fig10": ("spheres", "discrete_spheres.png"), "fig14": ("convergence", "discrete_convergence.png"),
    "fig16": ("cylinder", "discrete_cylinder.png"), "fig17": ("grid", "discrete_grid.png"),
    "fig18": ("absorption", "discrete_absorption.png"), "fig19": ("sizes", "discrete_sizes.png"),
    "fig20": ("times", "discrete_times.png"),
}

if __name__ == "__main__":
    command(__package__, __doc__, CLAIMS, "discrete-claims.md")
