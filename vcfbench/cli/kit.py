"""``vcfbench kit``: a program that records how real instruments answer, and the comparison of its bundles."""

from pathlib import Path
from typing import Annotated

import typer
from msgspec import to_builtins

from vcfbench.cli.answer import print_json
from vcfbench.cli.options import Json_, argument
from vcfbench.errors import ConfigError

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None, help="Record how instruments answer, and check it.")


@app.command("write")
def write(
    file: Annotated[Path, argument("FILE", "Where the program goes.")] = Path("vcfbench-kit.py"),
) -> None:
    """Write the kit: one file for another laboratory's rack, which needs Python and PyVISA alone."""
    from vcfbench.testing.kit.write import written  # noqa: PLC0415 - it loads every simulated instrument

    try:
        with file.open("x", encoding="utf-8") as opened:
            opened.write(written())
    except OSError as error:
        raise ConfigError(f"{file}: cannot be written: {error.strerror}") from None
    typer.echo(file)


@app.command("check")
def check(bundle: Annotated[Path, argument("BUNDLE", "What the kit has written.")], *, json: Json_ = False) -> None:
    """Compare the replies in a bundle with those of the simulated instruments: same, different or unknown.

    Exit code 1: something differs.
    """
    from vcfbench.testing.kit.check import checked  # noqa: PLC0415 - as above

    seen = checked(bundle)
    if json:
        print_json({"seen": [to_builtins(each) for each in seen]})
    else:
        for each in seen:
            typer.echo(str(each))
            for finding in each.findings:
                if finding.status != "same":
                    typer.echo(f"  {finding}")
    if any(each.differing for each in seen):
        raise typer.Exit(1)
