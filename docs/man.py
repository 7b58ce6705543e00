"""Man pages of all commands, from what click knows of them: `python docs/man.py build/man`, then `man -M build/man bake`."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from inspect import cleandoc
from pathlib import Path

import click

from bakery import __version__
from bakery.cli import COMMANDS, cli

STATUS = re.compile(r"^\| exit status .*\n\|.*\n((?:\|.*\n)+)", re.MULTILINE)
CONTRACT = Path(__file__).with_name("cli.md")


def roff(text: str) -> str:
    """Plain text as roff: `code` is bold, nothing else is a command."""
    text = text.replace("\\", r"\e").replace("-", r"\-")
    text = re.sub(r"`([^`]*)`", r"\\fB\1\\fR", text)
    return re.sub(r"^(?=[.'])", r"\\&", text, flags=re.MULTILINE)


def commands(command: click.Command, context: click.Context) -> Iterator[tuple[click.Command, click.Context]]:
    """A command and all below it."""
    yield command, context
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            inner = command.get_command(context, name)
            yield from commands(inner, click.Context(inner, info_name=name, parent=context))


def page(command: click.Command, context: click.Context, names: list[str]) -> str:
    """One man page; `names` are those of all pages."""
    words = context.command_path
    name, purpose = words.replace(" ", "-"), _purpose(command, context.parent)
    call = ".B " + roff(words.replace("bake bake", "bake")), roff(" ".join(command.collect_usage_pieces(context)))
    lines = [f'.TH "{roff(name.upper())}" 1 "" "bakery {__version__}" "Bakery"', ".SH NAME", f"{roff(name)} \\- {roff(purpose)}",
             ".SH SYNOPSIS", *call, ".SH DESCRIPTION", *_paragraphs(command.help or "")]
    if isinstance(command, click.Group):
        lines += [".SH COMMANDS", *_terms((inner, _purpose(command.get_command(context, inner), context))
                                          for inner in command.list_commands(context))]
    records = [parameter.get_help_record(context) for parameter in command.get_params(context)]
    options = [record for record in records if record and record[1]]  # the synopsis names arguments without a text of their own
    lines += [".SH OPTIONS", *_terms(options)] if options else []
    others = [roff(other) for other in names if other != name]
    return "\n".join([*lines, ".SH EXIT STATUS", *_terms(statuses()), ".SH SEE ALSO",
                      ",\n".join(f".BR {other} (1)" for other in others).replace("(1),", '"(1),"')]) + "\n"


def statuses() -> list[tuple[str, str]]:
    """Exit statuses and their meaning, from the table of docs/cli.md."""
    rows = STATUS.search(CONTRACT.read_text(encoding="utf-8"))[1].splitlines()
    return [tuple(cell.strip() for cell in row.strip("|").split("|")) for row in rows]


def _purpose(command: click.Command, parent: click.Context | None) -> str:
    if parent and parent.command is cli:
        return COMMANDS[command.name]
    return command.get_short_help_str(200).partition(":")[0].rstrip(".")


def _paragraphs(text: str) -> list[str]:
    """Paragraphs of a help text; those that begin with a backspace are kept line by line."""
    found: list[str] = []
    for part in re.split(r"\n\s*\n", cleandoc(text.partition("\f")[0])):
        kept = part.startswith("\b")
        found += [".PP", *([".nf", roff(part.lstrip("\b\n")), ".fi"] if kept else [roff(" ".join(part.split()))])]
    return found


def _terms(pairs) -> list[str]:
    return [line for term, text in pairs for line in (".TP", f".B {roff(term)}", roff(" ".join(text.split())))]


def main(folder: str) -> None:
    target = Path(folder) / "man1"
    target.mkdir(parents=True, exist_ok=True)
    found = list(commands(cli, click.Context(cli, info_name="bake", **cli.context_settings)))
    names = [context.command_path.replace(" ", "-") for _, context in found]
    for name, (command, context) in zip(names, found, strict=True):
        (target / f"{name}.1").write_text(page(command, context, names), encoding="utf-8")
    print(target)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", help="pages go into its folder man1; it is made where it is missing")
    main(parser.parse_args().folder)
