"""``vcfbench article``: the paper's printed numbers against those of the simulated bench, its figures and errata."""

from pathlib import Path  # typer reads the annotation when it runs
from typing import Annotated

import typer
from msgspec import to_builtins

from vcfbench.cli.answer import print_json
from vcfbench.cli.options import Json_, Quiet_, option, output_option
from vcfbench.validation.article import Mark, write_article
from vcfbench.validation.article import article as made


def article(
    seed: Annotated[int, option(None, "Seed of the simulated bench.", min=0)] = 1,
    output: Annotated[
        Path | None, output_option("File of the document: .html, .pdf or .md; without it no document is written.")
    ] = None,
    *,
    json: Json_ = False,
    quiet: Quiet_ = False,
) -> None:
    """Make the paper's numbers, figures and errata again, with a mark at each printed number.

    Exit code 1: a number is not that of the paper.
    """

    def shown(each: Mark) -> None:
        if not (json or quiet):
            ours = f"{each.ours:.6g}" + (f" +- {each.ours_u95:.2g}" if each.ours_u95 else "")
            said = f"printed {each.printed:.6g}, here {ours} {each.unit}".rstrip()
            typer.echo(f"{'holds' if each.holds else 'NOT SO':7} {each.where:12} {each.what}: {said}")

    found = made(seed, shown=shown)
    written = () if output is None else write_article(found, output)
    if json:
        plain = {key: value for key, value in to_builtins(found).items() if key != "figures"}
        print_json({**plain, "holds": found.holds, "document": list(map(str, written))})
    else:
        for erratum in () if quiet else found.errata:
            said = (
                f"{erratum.printed}: {erratum.by_printed:.5g}; {erratum.holds}: {erratum.by_correct:.5g} {erratum.unit}"
            )
            typer.echo(f"{'erratum' if erratum.shown else 'NOT SO':7} {erratum.where:12} {said}")
        marks = f"{sum(each.holds for each in found.marks)} of {len(found.marks)} printed numbers hold"
        errata = f"{sum(each.shown for each in found.errata)} of {len(found.errata)} errata shown"
        typer.echo(f"{marks}, {errata}, in {found.took_s:.0f} s")
        for each in written:
            typer.echo(f"document: {each}")
    if not found.holds:
        raise typer.Exit(1)
