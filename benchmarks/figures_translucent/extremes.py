"""Bodies at the ends: very small and large ones, no scattering and no absorption, light that scatters far forward."""

from benchmarks.figures_goa import measures as of
from benchmarks.sizes import sized

from . import stand

# radius in mean free paths, albedo, g, index; light 1 from everywhere alone, of which 1 has to be seen, or a panel and a sky
CASES = {
    "ball of 0.01 mean free paths": (0.01, 0.99, 0.0, 1.0, False), "the same, index 1.4": (0.01, 0.99, 0.0, 1.4, False),
    "1000 mean free paths": (1000.0, 0.99, 0.0, 1.0, False), "1000, index 1.4": (1000.0, 0.99, 0.0, 1.4, False),
    "5, g = 0.95": (5.0, 0.99, 0.95, 1.0, False), "50, g = 0.95": (50.0, 0.99, 0.95, 1.0, False),
    "5, albedo 0": (5.0, 0.0, 0.0, 1.4, False), "5, albedo 1": (5.0, 1.0, 0.0, 1.0, False),
    "5, albedo 1, light 1 from everywhere": (5.0, 1.0, 0.0, 1.0, True),
    "the same, with index 1.4": (5.0, 1.0, 0.0, 1.4, True),
    "50, albedo 1, light 1 from everywhere": (50.0, 1.0, 0.0, 1.0, True),
}
CASES = dict(list(CASES.items())[:sized(None, 1)])
METHODS = "paths", "shells", "vrl+tables", "vrl+tables, mirrored", "vrl+tables, none"
SECONDS = {"paths": 6.0}
OTHERS = 3.0
OF = 2  # pictures are so many times smaller than asked for


def measure(size, share):
    """By case and method: scattered light, or where it is everywhere, all."""
    numbers = {"size": size // OF, "share": share}
    for name, (radius, albedo, g, index, room) in CASES.items():
        plain = stand.ball(stand.medium(albedo, g), index, size // OF, stand.SKY if room else stand.PANEL + stand.SKY)
        how = stand.thicker(plain, radius)
        runs = {method: stand.Run(how, method) for method in METHODS}
        stand.together(runs, {method: share * SECONDS.get(method, OTHERS) for method in runs}, 2)
        numbers[name] = {method: run.found(stand.ALL if room else stand.SCATTERED) for method, run in runs.items()}
        print(name, flush=True)
    return numbers


def tables(numbers):
    body = []
    for name, (*_, room) in CASES.items():
        by = numbers[name]
        body.append([name, stand.over(by["paths"].total, by["paths"].error, 4),
                     *(stand.over(by[method].total, by[method].error) if room
                       else stand.over(*stand.ratio(by[method], by["paths"])) for method in METHODS[1:])])
    head = ["body", "`paths`", *(f"`{method}`" for method in METHODS[1:])]
    times = SECONDS | {"others": OTHERS}
    return {"extremes": of.table(head, body) + "\n\n" + stand.conditions(numbers["size"], times, numbers["share"])}
