# noqa: INP001 - a script, not a package
"""Makes the page of the command line, the help of every command.

The site has it (docs/site_hook.py); `python docs/make_cli.py` prints it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from typer.main import get_command

from vcfbench.cli.main import app

if TYPE_CHECKING:
    from collections.abc import Iterator

HEAD = """\
# Command line

The help of every command. Which procedure is for what is in
[procedures](procedures/index.md).
"""


def cli_page() -> str:
    """Return the page."""
    command = get_command(app)
    return "\n".join([HEAD, *described(command, command.make_context("vcfbench", ["sim"], resilient_parsing=True))])


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
    print(cli_page(), end="")  # noqa: T201
