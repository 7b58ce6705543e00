"""What shells are offered for values: formats, qualities, stages, paths inside of an asset."""

from click.shell_completion import CompletionItem

from bakery.grammar.qualities import QUALITIES


def among(choices: dict[str, str]):
    """Completes names, each with its meaning."""
    return lambda ctx, param, incomplete: _items(choices, incomplete)


def qualities(_ctx, _param, incomplete):
    """Qualities of bakes and pictures."""
    return _items({name: quality.words for name, quality in QUALITIES.items()}, incomplete)


def stages(_ctx, _param, incomplete):
    """Names of stages, in the order in which a plan runs them."""
    from bakery.stages import all_stages

    return _items({stage.name: stage.title for stage in all_stages()}, incomplete)


def scene_methods(_ctx, _param, incomplete):
    """Methods of materials, the last of a list of them."""
    from renderers.scene.entries import KINDS, declared

    before = incomplete[:incomplete.rfind(",") + 1]
    return _items({before + name: method.words for kind in KINDS for name, method in declared(kind).items()}, incomplete)


def starts(_ctx, _param, incomplete):
    """Recipes and scenes to start from."""
    from bakery.recipe.starting import starts as recipes
    from bakery.starting.shipped import scenes

    return _items({start.name: start.about for start in (*recipes().values(), *scenes().values())}, incomplete)


def datasets(ctx, _param, incomplete):
    """Paths of the datasets of the asset that is named before, and what can be asked of its medium."""
    from bakery.stages import all_stages
    from bakery.store.tree import Dataset

    stored = dict(_members(ctx))
    asked = {query.path: f"with {query.example}" for stage in all_stages() for query in stage.queries
             if query.bare and "medium" in stored}
    arrays = {path: member.description for path, member in stored.items() if isinstance(member, Dataset)}
    return _items(arrays | asked, incomplete)


def members(ctx, _param, incomplete):
    """Paths of its groups, too."""
    return _items({path: getattr(member, "description", "") for path, member in _members(ctx)}, incomplete)


def _members(ctx) -> list:
    from bakery.errors import BakeryError
    from bakery.store.read import read

    try:
        return list(read(ctx.params["asset"]).walk())
    except (BakeryError, KeyError, TypeError):
        return []  # no asset yet, or none that can be read: the command will say so


def _items(choices: dict[str, str], incomplete: str) -> list[CompletionItem]:
    # descriptions may come from strangers, and a line break would be taken for the next word
    return [CompletionItem(name, help=description if description.isprintable() else None)
            for name, description in choices.items() if name.startswith(incomplete)]
