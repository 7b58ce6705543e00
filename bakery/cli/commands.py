"""All commands, and how the call of one ends.

Commands are imported when they are called, so that `bake --help` starts without NumPy.  Results go to standard output,
progress and messages to standard error; a `BakeryError` becomes its message and its exit status.
"""

import os
import sys
from importlib import import_module

import click

from bakery import __version__
from bakery.errors import BakeryError, Interrupted, RecipeError, StoreError
from bakery.system import memory, signals, streams
from bakery.system.terminal import remark, warned

# name -> help line; the module bakery.cli.NAME holds the click command `command`
COMMANDS = {
    "new": "write a commented recipe to start from",
    "bake": "bake recipes into assets (the default: `bake fog.yaml`)",
    "plan": "show what a bake or a render would run, why, and what it will cost",
    "inspect": "print the tree of an asset",
    "verify": "check an asset's integrity and physics",
    "diff": "compare the values of two assets",
    "query": "print one baked value",
    "plot": "draw pictures of an asset's contents",
    "report": "write one self-contained page about an asset",
    "render": "render an asset's preview, or a scene",
    "compare": "render a scene with several methods and compare them",
    "export": "write an asset for other software",
    "trade": "measure error against time, of a recipe's settings or a scene's methods",
    "schema": "print the recipe's JSON Schema",
    "cache": "show or clean up the cache of finished stages",
    "cluster-script": "print a script that starts a cluster for --cluster: slurm or local",
    "completion": "print the shell's completion script",
}

TELLING = ("bake", "plan", "trade", "render", "compare")  # commands that report their own progress


def is_recipe(word: str) -> bool:
    """A first word that ends in .yaml or .yml or holds a slash is a recipe, not a command."""
    return word.endswith((".yaml", ".yml")) or "/" in word


class Commands(click.Group):
    """Loads a command when it is called; `bake RECIPE…` is `bake bake RECIPE…`."""

    def list_commands(self, ctx):
        return list(COMMANDS)

    def get_command(self, ctx, name):
        if name not in COMMANDS:
            return None
        return import_module(f"bakery.cli.{name.replace('-', '_')}").command

    def resolve_command(self, ctx, args):
        name, command, remaining = super().resolve_command(ctx, args)
        if name not in TELLING:
            from bakery.run.progress import Lines

            waiting = Lines()  # to look into a large asset takes seconds: after a moment say so
            waiting.begin(f"bake {name}")
            ctx.call_on_close(waiting.close)
        return name, command, remaining

    def invoke(self, ctx):
        try:
            with warned():
                return super().invoke(ctx)
        except KeyboardInterrupt:
            remark("")  # after the terminal's ^C; click's own way fails where standard error is full
            raise Interrupted("interrupted; no file is incomplete, and finished stages of a bake are in the cache") from None

    def format_commands(self, ctx, formatter):
        # from the table: help must not import the commands
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def parse_args(self, ctx, args):
        # options may stand before the recipe: `bake -o out.h5 fog.yaml` is a bake too
        first = next((a for a in args if not a.startswith("-")), None)
        if args and args[0] not in COMMANDS and (is_recipe(args[0]) or (args[0].startswith("-") and any(map(is_recipe, args)))):
            args = ["bake", *args]
        elif first is not None and first not in COMMANDS and args[0] == first:
            self.unknown(first)
        return super().parse_args(ctx, args)

    def shell_complete(self, ctx, incomplete):
        import glob

        from click.shell_completion import CompletionItem

        recipes = sorted(glob.glob(glob.escape(incomplete) + "*.y*ml")) + sorted(glob.glob(glob.escape(incomplete) + "*/"))
        return super().shell_complete(ctx, incomplete) + [CompletionItem(name) for name in recipes]

    def unknown(self, word: str):
        from bakery.grammar.text import closest

        near = f"inspect {word}" if word.endswith(".h5") else closest(word, COMMANDS)
        raise click.UsageError(
            f'found "{word}", which is neither a command nor a recipe (a recipe ends in .yaml or holds a slash)'
            + (f"; did you mean {near}?" if near else "; see bake --help")
        )


def versions() -> str:
    """Version of bakery and of the libraries that decide what is stored."""
    from importlib.metadata import PackageNotFoundError, version

    import h5py

    parts = [f"bakery {__version__}", f"HDF5 {h5py.version.hdf5_version}"]
    for name in ("h5py", "numpy", "scipy", "numba", "mitsuba"):
        try:
            parts.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            parts.append(f"{name} not installed")
    return ", ".join(parts)


def print_version(ctx, _param, value):
    if value and not ctx.resilient_parsing:
        click.echo(versions())
        ctx.exit()


@click.group(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    help="Bake scattering materials for rendering: recipes in, one HDF5 asset out.\n\n"
    "bake fog.yaml bakes a recipe; bake COMMAND --help explains a command.",
)
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=print_version, help="Print versions.")
def cli():
    pass


def run(args: list[str] | None = None) -> int:
    """Run the command line as the only thing that this process is for; the status."""
    streams.prepare()
    # before NumPy is loaded: on matrices of a hundred rows OpenBLAS's own threads gain nothing, and wait for each other in loops,
    # which on a busy machine takes twenty times the work
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    memory.refuse_what_does_not_fit()
    status = status_of(args)
    streams.flush()
    return status


def status_of(args: list[str] | None = None) -> int:
    """Run the command line; every failure that a user can cause becomes one message and a status."""
    try:
        result = cli.main(args=args, prog_name="bake", standalone_mode=False)
        sys.stdout.flush()
        return result if isinstance(result, int) else 0
    except click.exceptions.Exit as stop:
        return stop.exit_code
    except click.UsageError as error:
        where = error.ctx.command_path if error.ctx else "bake"
        remark(f"{where}: {error.format_message()}")
        return 2
    except click.ClickException as error:
        remark(f"bake: {error.format_message()}")
        return 2
    except (KeyboardInterrupt, click.Abort, signals.Terminated) as ending:
        return signals.ended(ending)
    except RecipeError as error:
        if "--json" in (sys.argv[1:] if args is None else args):
            _print_problems(error)
        remark(str(error))
        return error.exit_status
    except BakeryError as error:
        remark(str(error))
        return error.exit_status
    except (MemoryError, ImportError, OSError, RuntimeError) as error:
        if not memory.exhausted(error):
            raise
        why = f" ({error})" if str(error) else ""
        remark(f"out of memory{why}; `bake plan RECIPE` says what a bake needs")
        return 3


def _print_problems(error: RecipeError) -> None:
    from bakery.cli.options import print_json

    try:
        print_json({"problems": [problem.as_dict() for problem in error.problems]})
        sys.stdout.flush()
    except StoreError as unwritten:
        remark(str(unwritten))
