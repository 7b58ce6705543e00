"""Command line: see the package."""

from benchmarks.claims import command

CLAIMS = {  # name on the command line: (module, picture)
    "fig9": ("fluence", "granular_fluence.png"), "orders": ("orders", "granular_orders.png"),
    "table2": ("unit_variance", "granular_unit_variance.png"),
}

if __name__ == "__main__":
    command(__package__, __doc__, CLAIMS, "granular-claims.md")
