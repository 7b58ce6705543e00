"""`bake schema`: the recipe's JSON Schema."""

import click

from bakery.cli.options import print_json


@click.command(name="schema", short_help="print the recipe's JSON Schema")
def command():
    """Print the JSON Schema of recipes, for editors that complete and check YAML (docs/cli.md shows how)."""
    from bakery.recipe import json_schema

    print_json(json_schema())
