"""``vcfbench bench new``: finds instruments, asks, and writes the bench file of a station."""

from __future__ import annotations

from pathlib import Path  # typer reads the annotations when it runs
from typing import Annotated

import typer

from vcfbench.cli.interview import Interview, written_anew
from vcfbench.cli.options import AnswerTime_, Library_, ProbeSerial_, Trace_, Tries_, key_and_value, tracing
from vcfbench.cli.station_questions import DiscoveryOptions, interviewed
from vcfbench.clock import utc_now
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.station.new_station import Draft

File_ = Annotated[
    Path, typer.Argument(metavar="FILE", help="Where the bench file goes. A file there is not overwritten.")
]


def new(
    file: File_ = Path("station.toml"),
    library: Library_ = "@py",
    tries: Tries_ = None,
    served: Annotated[
        str | None,
        typer.Option("--served", metavar="PORT", help="Use the bench that `sim serve` serves: its control port."),
    ] = None,
    answers: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="The value of a key of the file, which is then not asked for."),
    ] = None,
    *,
    timeout: AnswerTime_ = 1.0,
    probe_serial: ProbeSerial_ = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing: use what is found and proposed.")] = False,
    trace: Trace_ = None,
) -> None:
    """Make the bench file of a station: find the instruments, ask for the rest, write the file with comments.

    Enter accepts what is proposed. Each answer is checked at once. Nothing is written before the last one.
    """
    given = dict(key_and_value("--set", each, "limits.max_rate_deg_s=100") for each in answers or ())
    interview = Interview(given, silent=yes)
    path = interview.free_file(file)
    draft = Draft(str(path))
    with tracing(trace):
        interviewed(draft, interview, DiscoveryOptions(library, tuple(tries or ()), timeout, probe_serial, served))
    interview.require_all_used()
    # Check the file as a whole and write it
    text = draft.text(f"Written by `vcfbench bench new` on {utc_now():%Y-%m-%d}.")
    parse_bench(text, str(path))
    written_anew(path, text)
    typer.echo(f"{path} is written; next: vcfbench bench check --bench {path}")
    if yes:
        typer.echo("nobody has looked at its [limits], [wiring] and [site]: do, before anything moves", err=True)
