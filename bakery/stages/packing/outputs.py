"""What the stage `packing` stores: names, shapes, units and ranges, of one tile or of each of a dictionary."""

from dataclasses import replace

from bakery.stages.declaration import ANY, Output

TILE = (
    Output("centers", "(N, 3)", "1", "centres of the spheres, in mean radii, from 0 to the edges of the cell"),
    Output("radii", "(N,)", "1", "radii of the spheres over their mean"),
    Output("cell", "(3,)", "1", "edges of the periodic cell, in mean radii"),
    Output("fraction", "(1,)", "1", "share of the cell in spheres", within=(0, 1)),
    Output("fraction_wished", "(1,)", "1", "share that the recipe asks for", within=(0, 1)),
    Output("smallest_gap", "(1,)", "1", "smallest distance of two surfaces, in mean diameters", within=ANY),
    Output("contacts_per_sphere", "(1,)", "1", "mean number of gaps below 1e-3 mean diameters a sphere"),
    Output("contacts_per_sphere_error", "(1,)", "1", "standard error of contacts_per_sphere, between tiles of the kind"),
    Output("rattlers", "(1,)", "1", "share of spheres with fewer than four contacts, other such spheres not counted",
           within=(0, 1)),
    Output("bond_order", "(1,)", "1", "global Q6 of bonds up to 1.4 contact distances: 0.57 in fcc, 0.48 in hcp crystals",
           within=(0, 1)),
    Output("bond_order_random", "(1,)", "1", "Q6 of as many bonds in random directions", within=(0, 1)),
    Output("bond_order_local", "(1,)", "1", "mean over spheres of q6 of their own bonds", within=(0, 1)),
    Output("pressure", "(1,)", "1", "PV/NkT at the end of the dynamics", optional=True),
    Output("pair_correlation/edges", "(P + 1,)", "1", "edges of the bins of r", optional=True),
    Output("pair_correlation/r", "(P,)", "1", "distance of centres in mean radii, middle of the bin", optional=True),
    Output("pair_correlation/g", "(P,)", "1", "density of centres over the mean density, mean over the shell", optional=True),
    Output("pair_correlation/g_error", "(P,)", "1", "standard error of g, between tiles of the kind", optional=True),
    Output("chord_length/edges", "(C + 1,)", "1",
           "edges of the bins of length, in mean radii; the last is the longest chord seen"),
    Output("chord_length/density", "(C,)", "1", "density of chords between spheres along isotropic lines, mean over the bin"),
    Output("chord_length/density_error", "(C,)", "1", "standard error of density, from the number of lines"),
    Output("chord_length/mean", "(1,)", "1", "mean chord in mean radii"),
    Output("chord_length/mean_error", "(1,)", "1", "standard error of mean, from the number of lines"),
    Output("chord_length/mean_exact", "(1,)", "1", "4 V/S, volume outside over surface of the spheres"),
    Output("chord_length/second_moment", "(1,)", "1", "mean square over twice the squared mean: 1 for an exponential law"),
    Output("chord_length/second_moment_error", "(1,)", "1", "standard error of second_moment, from the number of lines"),
    Output("chord_length/cut", "(1,)", "1", "share of the chords that were followed no further than 1000 mean chords",
           within=(0, 1)),
)
OUTPUTS = tuple(replace(output, path=prefix + output.path, optional=True)
                for prefix in ("", "TILE/") for output in TILE)
REQUIRED = tuple(output.path for output in TILE if not output.optional)
TOGETHER = tuple((path, *(output.path for output in OUTPUTS if output.path.startswith(f"{path}/")))
                 for path in ("pair_correlation", "TILE/pair_correlation"))
