"""``vcfbench bench new``: finds instruments, asks, and writes the bench file of a station."""

from __future__ import annotations

from pathlib import Path  # typer reads the annotations when it runs
from typing import Annotated

import typer

from vcfbench.cli.interview import Interview, written_anew
from vcfbench.cli.station_questions import DiscoveryOptions, interviewed
from vcfbench.cli.tracing import Trace_, tracing
from vcfbench.clock import utc_now
from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.station.new_station import Draft

File_ = Annotated[
    Path, typer.Argument(metavar="FILE", help="Where the bench file goes. A file there is not overwritten.")
]


def new(
    file: File_ = Path("station.toml"),
    library: Annotated[str, typer.Option("--library", help="PyVISA library; @vcfbench is simulated.")] = "@py",
    tries: Annotated[
        list[str] | None,
        typer.Option(
            "--try", metavar="RESOURCE", help="Ask this one too: a VISA resource, a port, socket://host:port."
        ),
    ] = None,
    served: Annotated[
        str | None,
        typer.Option("--served", metavar="PORT", help="Use the bench that `sim serve` serves: its control port."),
    ] = None,
    answers: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="The value of a key of the file, which is then not asked for."),
    ] = None,
    *,
    timeout: Annotated[
        float, typer.Option("--timeout", metavar="S", min=0.01, max=60.0, help="Longest wait for each answer.")
    ] = 1.0,
    probe_serial: Annotated[
        bool,
        typer.Option(
            "--probe-serial",
            help="Ask serial ports too. Check first what is on them: bytes can move an unknown device.",
        ),
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Ask nothing: use what is found and proposed.")] = False,
    trace: Trace_ = None,
) -> None:
    """Make the bench file of a station: find the instruments, ask for the rest, write the file with comments.

    Enter accepts what is proposed. Each answer is checked at once. Nothing is written before the last one.
    """
    interview = Interview(_given(answers or []), silent=yes)
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


def _given(answers: list[str]) -> dict[str, str]:
    pairs = [answer.partition("=") for answer in answers]
    for answer, (key, equals, _) in zip(answers, pairs, strict=True):
        if not (key.strip() and equals):
            raise ConfigError(f"--set {answer}: expected KEY=VALUE, as in limits.max_rate_deg_s=100")
    return {key.strip(): value.strip() for key, _, value in pairs}
