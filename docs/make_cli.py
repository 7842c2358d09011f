# noqa: INP001 - a script, not a package
"""Writes docs/cli.md, the help of every command, from the commands themselves: `python docs/make_cli.py`."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typer.main import get_command

from vcfbench.cli.main import app

if TYPE_CHECKING:
    from collections.abc import Iterator

PAGE = Path(__file__).with_name("cli.md")
HEAD = """\
# Command line

The help of every command, made by `python docs/make_cli.py`. Which procedure is for what is in
[procedures](procedures/index.md).
"""


def main() -> None:
    """Write the page, or with ``--check`` tell by the exit code whether it has all commands and their options."""
    command = get_command(app)
    page = "\n".join([HEAD, *described(command, command.make_context("vcfbench", ["sim"], resilient_parsing=True))])
    if "--check" in sys.argv[1:]:  # how lines are set is up to the version of Typer
        sys.exit(named_in(PAGE.read_text(encoding="utf-8")) != named_in(page))
    PAGE.write_text(page, encoding="utf-8")


def named_in(page: str) -> list[str]:
    """Return the commands and, after each, its options."""
    return [
        each
        for part in page.split("\n## ")
        for each in (part.partition("\n")[0], *sorted(set(re.findall(r"--[a-z][\w-]*", part))))
    ]


def described(command: Any, context: Any) -> Iterator[str]:
    """Yield the help of `command` and of all below it."""
    context.terminal_width = context.max_content_width = 100
    words = "\n".join(line.rstrip() for line in command.get_help(context).splitlines())
    yield f"## {context.command_path}\n\n```text\n{words}\n```\n"
    for name in command.list_commands(context) if hasattr(command, "list_commands") else ():
        below = command.get_command(context, name)
        if not below.hidden:
            yield from described(below, type(context)(below, parent=context, info_name=name))


if __name__ == "__main__":
    main()
