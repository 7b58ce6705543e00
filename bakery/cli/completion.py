"""`bake completion SHELL`: click's own script."""

import click

SHELLS = {"bash": "~/.bashrc", "zsh": "~/.zshrc", "fish": "~/.config/fish/completions/bake.fish"}


@click.command(name="completion", short_help="print the shell's completion script")
@click.argument("shell", type=click.Choice(tuple(SHELLS)))
def command(shell):
    """Print the completion script of SHELL: bash, zsh or fish.

    \b
    bash  bake completion bash >> ~/.bashrc
    zsh   bake completion zsh >> ~/.zshrc
    fish  bake completion fish > ~/.config/fish/completions/bake.fish
    """
    from click.shell_completion import get_completion_class

    from bakery.cli import cli

    # not through `source()`: for bash that would run the machine's bash to look at its version
    script = get_completion_class(shell)(cli, {}, "bake", "_BAKE_COMPLETE")
    click.echo(script.source_template % script.source_vars())
