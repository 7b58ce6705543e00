"""What the boundaries of tables get wrong: a ball under a panel and a sky, by its radius and medium."""

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized

from . import stand

PAGE = "measurements/translucent.md"
RADII = sized((0.5, 2.0, 5.0, 20.0, 100.0), (2.0,))  # mean free paths
ALBEDOS, COSINES, INDICES = sized((0.5, 0.95, 0.99, 0.999), (0.5,)), sized((0.0, 0.8), (0.0,)), sized((1.0, 1.4), (1.4,))
BOUNDARIES = ("negative", "mirrored", "none")
SECONDS = {"paths": 3.0, "few": 1.0, "negative": 3.5, "mirrored": 1.0, "none": 1.0}
SHOWN = sized((0.5, 5.0, 100.0), RADII)  # in the table
OF = 2  # pictures are so many times smaller than asked for


def measure(size, share):
    """By index, g, albedo, radius: of `paths` and of each boundary, the light of three and more events."""
    numbers = {"size": size // OF, "share": share}
    for index in INDICES:
        for g in COSINES:
            for albedo in ALBEDOS:
                plain = stand.ball(stand.medium(albedo, g), index, size // OF)
                for radius in RADII:
                    here = numbers[index, g, albedo, radius] = _measured(stand.thicker(plain, radius), share)
                    print(f"index {index:g}, g {g:g}, albedo {albedo:g}, radius {radius:g}: {_light(here)}", flush=True)
    return numbers


def _measured(how, share):
    runs = {"paths": stand.Run(how, "paths"), "few": stand.Run(how, "vrl+tables", 1, ("few",))}
    runs |= {boundary: stand.Run(how, f"vrl+tables, {boundary}", 1, ("beams",)) for boundary in BOUNDARIES}
    stand.together(runs, {name: share * seconds for name, seconds in SECONDS.items()}, 2)
    paths, few = runs["paths"], runs["few"]
    return {"paths": paths.found(stand.LATER)} | {name: runs[name].found(stand.LATER, few) for name in BOUNDARIES}


def tables(numbers):
    light = []
    for index in INDICES:
        for g in COSINES:
            for albedo in ALBEDOS[1:] or ALBEDOS:  # the darkest are measured, but mostly noise
                light.append([f"{index:g}", f"{g:g}", f"{albedo:g}",
                              *(_light(numbers[index, g, albedo, radius]) for radius in SHOWN)])
    head = ["index", "g", "albedo", *(f"R = {radius:g}" for radius in SHOWN)]
    times = stand.conditions(numbers["size"], SECONDS, numbers["share"])
    return {"boundaries_light": of.table(head, light) + "\n\n" + times}


def _light(found):
    ratios = {name: stand.ratio(found[name], found["paths"]) for name in BOUNDARIES}
    return f"{stand.over(*ratios['negative'], 2)} / {ratios['mirrored'][0]:.2f} / {ratios['none'][0]:.2f}"
