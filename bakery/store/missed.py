"""Whether the stages of an asset reach their tolerances and targets: the one rule that every command reads.

A stage misses where `achieved_error` is above `tolerance`, or where it says itself that a target was missed (`missed` in its
provenance).  Both are stored with the values, so a bake that finds its asset up to date says the same as the one that made it.
"""

from bakery.store.tree import Group, is_text


def missed(root: Group) -> dict[str, str]:
    """Stage -> what it misses, in a line; of the stages that miss something."""
    lines = {}
    for name, group in root.members.items():
        if isinstance(group, Group):
            misses = [*_error(group.attributes), *_missed_targets(root, name)]
            if misses:
                lines[name] = "; ".join(misses)
    return lines


def too_large(attributes) -> bool:
    """Whether the error of a stage is above its tolerance; from the attributes of its group."""
    achieved, tolerance = attributes.get("achieved_error"), attributes.get("tolerance")
    return isinstance(achieved, float) and isinstance(tolerance, float) and not achieved <= tolerance


def _error(attributes) -> list[str]:
    if not too_large(attributes):
        return []
    return [f"its error is {attributes['achieved_error']:.3g}, above the tolerance of {attributes['tolerance']:.3g}"]


def _missed_targets(root: Group, name: str) -> list[str]:
    try:
        stored = root[f"provenance/{name}/missed"]
    except KeyError:
        return []
    return stored.data.tobytes().decode(errors="replace").splitlines() if is_text(stored) else []
