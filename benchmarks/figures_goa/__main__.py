"""Command line: see the package."""

from benchmarks.claims import command

CLAIMS = {  # name on the command line: (module, picture)
    "fig2": ("orders", "goa_orders.png"), "fig3": ("extinction", "goa_extinction.png"),
    "fig4": ("amplitudes", "goa_amplitudes.png"), "fig6": ("trade", "goa_trade.png"),
    "fig11": ("diffraction", "goa_diffraction.png"),
    "fig13": ("henyey_greenstein", "goa_henyey_greenstein.png"), "rays": ("one_ray", "goa_one_ray.png"),
    "absorption": ("absorption", "goa_absorption.png"), "corrections": ("corrections", "goa_corrections.png"),
}

if __name__ == "__main__":
    command(__package__, __doc__, CLAIMS, "goa-claims.md")
