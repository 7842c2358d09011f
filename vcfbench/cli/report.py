"""``vcfbench report``: the whole report of a run in one file, or of many."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import typer

from vcfbench.archive.recorded import load_run
from vcfbench.archive.run import Run
from vcfbench.archive.summary import run_summaries
from vcfbench.archive.written import write_certificate, write_report
from vcfbench.cli.options import Run_, Runs_, flag, keys_and_values, option, output_option, tags_of
from vcfbench.errors import ConfigError
from vcfbench.files import parse_toml, read_text, shown


def report(  # noqa: PLR0917  # options of a command
    run: Run_ = "last",
    output: Annotated[
        Path | None,
        output_option("Where the report goes: .html, .pdf or .md; of several a directory.  [default: RUN.html]"),
    ] = None,
    runs: Runs_ = Path("runs"),
    words: Annotated[
        list[str] | None, option("KEY=VALUE", "Set a field of the certificate, customer=ACME. Repeatable.", "--set")
    ] = None,
    template: Annotated[
        Path | None, option("FILE", "TOML file with such fields, title and logo for all reports.")
    ] = None,
    tag: Annotated[list[str] | None, option("KEY=VALUE", "A report of each run with this tag. Repeatable.")] = None,
    embed: Annotated[Path | None, option("FILE", "With --dcc: embed this PDF in the certificate.")] = None,
    *,
    every: Annotated[bool, flag("A report of each run in the directory of --runs.", "--all")] = False,
    as_: Annotated[
        Literal["html", "pdf", "md"], option(None, "Format of the reports with --all or --tag.", "--as")
    ] = "html",
    dcc: Annotated[
        bool, flag("Write a Digital Calibration Certificate (XML, DCC 3.3.0), not signed.", "--dcc")
    ] = False,
) -> None:
    """Write the report of a run: a first page with the results, then all that they rest on."""
    every = every or bool(tag)
    if embed is not None and (every or not dcc):
        raise ConfigError("--embed: a PDF goes into the one certificate of --dcc")
    said: dict[str, str] = {}
    if template is not None:
        said = parse_toml(read_text(template, "a template"), shown(template))
        if other := [key for key, value in said.items() if not isinstance(value, str)]:
            raise ConfigError(f"{template}: expected texts by key, got something else for {', '.join(other)}")
        said |= {"logo": str(template.parent / said["logo"])} if "logo" in said else {}  # which lies beside it
    said |= keys_and_values("--set", words or (), "customer=ACME")
    if not every:
        recorded = load_run(run, runs)
        _write(recorded, output or Path(f"{recorded.name}.{'xml' if dcc else 'html'}"), said, embed, dcc=dcc)
        return
    folder = output or Path()
    if not folder.is_dir():
        raise ConfigError(f"expected a directory in -o, got {str(folder)!r}", hint="make it first")
    chosen = run_summaries(runs, tags=tags_of(tag or ()))
    if not chosen:
        raise ConfigError(f"{runs} has no run of that name")
    kind, without = "xml" if dcc else as_, list[str]()
    for each in chosen:
        try:
            _write(load_run(each.directory), folder / f"{each.run}.{kind}", said, None, dcc=dcc)
        except ConfigError as error:  # the others have theirs all the same
            typer.echo(f"vcfbench: {error}", err=True)
            without.append(each.run)
    if without:
        raise ConfigError(f"{len(without)} of {len(chosen)} runs have no report: {', '.join(without)}")


def _write(run: Run, path: Path, words: Mapping[str, str], embed: Path | None, *, dcc: bool) -> None:
    if dcc:
        fields = {key: value for key, value in words.items() if key not in {"title", "logo"}}
        typer.echo(write_certificate(run, path, fields, embed))
        return
    for written in write_report(run, path, words):
        typer.echo(written)
