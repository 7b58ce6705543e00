"""Command line: see the package."""

from benchmarks.claims import command
from benchmarks.sizes import sized

CLAIMS = {  # name on the command line: (module, picture)
    "fig27": ("times", "translucent_times.png"), "fig19": ("infinite", "translucent_infinite.png"),
    "fig20": ("diffusion", "translucent_diffusion.png"), "fig25": ("radii", "translucent_radii.png"),
    "fig32": ("obstacles", "translucent_obstacles.png"), "boundaries": ("boundaries", None),
    "fig30": ("mutations", None),
}
SETTINGS = {  # of `measure`: (kind, value if not said, what it is)
    "size": (int, sized(48, 8), "pixels along a side of pictures"),
    "share": (float, sized(1.0, 0.005), "factor of all processor times"),
}

if __name__ == "__main__":
    command(__package__, __doc__, CLAIMS, "translucent-claims.md", SETTINGS)
