"""What a scene of several materials needs of a recipe: for each entry that is made of it what its kind needs alone."""

from __future__ import annotations

from renderers.mixed.scene import chosen
from renderers.scene.requirements import Need, merged


def needs(about) -> list[Need]:
    """Requirements of all stages that entries of the recipe read; see `renderers.scene.requirements`."""
    from renderers.materials.grains import requirements as grains
    from renderers.materials.particles import requirements as particles

    entries = about.scene.values.materials
    groups: dict[tuple[str, str], list[int]] = {}
    for number in about.bodies:
        groups.setdefault((entries[number].kind, chosen(entries[number].kind, entries[number].method)), []).append(number)
    rules = {"particles": particles.needs, "grains": grains.needs, "medium": _of_medium, "body": _of_medium}
    return list(merged([rules[kind](about.only(numbers, method)) for (kind, method), numbers in groups.items()],
                       about.recipe.leaves))


def _of_medium(about) -> list[Need]:
    return [Need("medium", True, "light goes through it")]
