"""What a scene of several materials needs of a recipe: for each entry that is made of it what its kind needs alone."""

from renderers.mixed.scene import METHODS, chosen
from renderers.scene.entries import has_surface
from renderers.scene.requirements import Need, merged


def needs(about) -> list[Need]:
    """Requirements of all stages that entries of the recipe read; see `renderers.scene.requirements`."""
    from renderers.materials.bodies import requirements as bodies
    from renderers.materials.grains import requirements as grains
    from renderers.materials.particles import requirements as particles

    entries = about.scene.values.materials
    groups: dict[tuple[str, str], list[int]] = {}
    surfaces: list[Need] = []
    for number in about.bodies:
        if has_surface(entries[number].kind, entries[number].method):
            surfaces.append(Need("surface", True, "light leaves it as by a baked layer"))
            surfaces.append(Need("medium", True, "light scattered once goes by it"))
            continue
        if entries[number].kind == "body" and entries[number].method == "auto":
            surfaces += bodies.surface(about.only([number], "auto"))
        for method in _methods(about, number, grains):
            groups.setdefault((entries[number].kind, method), []).append(number)
    rules = {"particles": particles.needs, "grains": grains.needs, "medium": _of_medium, "body": _of_medium}
    return list(merged([surfaces] + [rules[kind](about.only(numbers, method)) for (kind, method), numbers in groups.items()],
                       about.recipe.leaves))


def _methods(about, number, grains):
    """By which an entry may be rendered: `auto` may take the medium that stands for grains that nobody sees."""
    entry = about.scene.values.materials[number]
    method = chosen(entry.kind, entry.method)
    may_be_medium = entry.kind == "grains" and entry.method == "auto" and grains.unseen(about.only([number], method))
    return dict.fromkeys([method, *METHODS[entry.kind]]) if may_be_medium else [method]


def _of_medium(about) -> list[Need]:
    return [Need("medium", True, "light goes through it")]
