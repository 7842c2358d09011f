"""``vcfbench run`` and ``vcfbench resume``: hand on the options, and print the answer."""

from __future__ import annotations

import os
import sys
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import typer
from msgspec import Struct, structs, to_builtins

from vcfbench.cli.answer import given, print_json, print_report
from vcfbench.cli.person import agreed, at_the_terminal
from vcfbench.errors import BenchError
from vcfbench.records.metadata import metadata_of
from vcfbench.reports.shielded import NoProgress
from vcfbench.runs.conduct import conduct as conducted
from vcfbench.runs.request import Checked, Request, prepare
from vcfbench.safety.signals import StopSignals

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from contextlib import AbstractContextManager

    from vcfbench.archive.run import Run
    from vcfbench.cli.ending import SignalsWithoutBench
    from vcfbench.cli.keys import Keys
    from vcfbench.page.server import LivePage
    from vcfbench.procedures.procedure import AnyProcedure
    from vcfbench.runs.conduct import Preparing
    from vcfbench.runs.expected import Expectation
    from vcfbench.runs.request import Beginning, DryRun
    from vcfbench.safety.control import RunControl
    from vcfbench.station.layering import Layer

_WITHOUT_CURSOR: Final = frozenset({"dumb", "unknown"})
"""Terminals on which nothing can be drawn in place, by the name that they give themselves."""


class RunOptions(Struct, frozen=True):
    """Options of the command line."""

    bench: Path | None
    seed: int | None
    json: bool
    dry_run: bool
    runs: Path
    speed: str | None
    quiet: bool
    plain: bool
    page: bool
    port: int
    yes: bool
    settings: Mapping[str, Any]
    metadata: Mapping[str, Any]


def conduct(
    procedure: AnyProcedure, settings: Layer, options: RunOptions, ending: SignalsWithoutBench | None = None
) -> None:
    """Run or dry-run the procedure; the answer goes to stdout, every error is raised for the command's caller to tell.

    `ending` is told when the code is known, while signals are still held: what comes later shall not change it.
    """
    if options.dry_run:
        _dry_run(procedure, settings, options)
        return

    metadata = metadata_of(options.metadata)
    request = Request(procedure, options.bench, options.seed, settings, options.runs, options.speed, metadata=metadata)
    _carry_out(request, prepare, options, ending)


def resume(name: str, procedure: Path | None, options: RunOptions, ending: SignalsWithoutBench | None = None) -> None:
    """Take up the run called `name`, or recorded in that directory; the rest as of :func:`conduct`."""
    from vcfbench.runs.resumed import broken_off  # noqa: PLC0415

    broken = broken_off(name, options.runs)
    beside = broken.directory.path.parent
    if procedure is None:
        broken.require_trust(options.yes or agreed)
    request = Request(procedure or broken.procedure, options.bench, runs=beside, speed=options.speed)
    with broken.directory.alone():
        _carry_out(request, broken.prepare, options, ending)


def _carry_out(request: Request, preparing: Preparing, options: RunOptions, ending: SignalsWithoutBench | None) -> None:
    control = _control(options)
    with (
        StopSignals() as signals,  # until all is written: a second Ctrl-C shall not cost the results
        _page(request, options, control) as page,
    ):
        run = attended(structs.replace(request, control=control), preparing, options, signals, page)
        if page is not None:
            page.ended(run)
        unwritten = given(lambda: _show(run, options))
        if ending is not None:
            ending.answered()
    if run.error is not None:
        raise run.error
    if run.verdict is not None and not run.verdict.passed:
        raise typer.Exit(1)  # no error: a limit of the results failed, whether or not anybody could read it
    if unwritten is not None:
        unwritten.hint = None if run.directory is None else f"it is in the record {run.directory}"
        raise unwritten


def _control(options: RunOptions) -> RunControl | None:
    """Return the control that stops and pauses the run, None where nobody is there who could want that."""
    if not options.page and not _has_keys(options):
        return None
    from vcfbench.safety.control import RunControl  # noqa: PLC0415

    return RunControl()


def _page(request: Request, options: RunOptions, control: RunControl | None) -> AbstractContextManager[LivePage | None]:
    """Return the page of the run, which goes when it is left; None where none was asked for."""
    if not options.page or control is None:
        return nullcontext()
    from vcfbench.page.server import LivePage  # noqa: PLC0415  # few look at one

    page = LivePage(request.runs or options.runs, Path("devices"), options.port, control)
    typer.echo(f"page: {page.address}", err=True)
    return page


def _has_keys(options: RunOptions) -> bool:
    """Tell whether a person can press keys here, and sees their effect; Windows has no such terminal."""
    return (
        os.name == "posix"
        and not options.quiet
        and sys.stdin is not None
        and sys.stdin.isatty()
        and sys.stderr.isatty()
    )


@contextmanager
def _keys(options: RunOptions, control: RunControl | None) -> Iterator[Keys | None]:
    """Hear keys of the terminal while the run goes, where a person can press them."""
    if control is None or not _has_keys(options):
        yield None
        return
    from vcfbench.cli.keys import Keys  # noqa: PLC0415  # few look

    with Keys(control) as keys:
        yield keys


def attended(
    request: Request, preparing: Preparing, options: RunOptions, signals: StopSignals, page: LivePage | None
) -> Run:
    """Return the run, also one that an error ended."""
    try:
        with _keys(options, request.control) as keys:
            watched = structs.replace(
                request,
                display=lambda beginning: _progress(options, beginning, page, request.control),
                observers=() if page is None else (page,),
                person=at_the_terminal(signals, keys, yes=options.yes),
                options=structs.asdict(options),
                warn=lambda words: _warn(words, page),
                trust=options.yes or (lambda words: agreed(words, signals, keys)),
            )
            return conducted(watched, signals, preparing)
    except BenchError as error:
        if error.run is None:  # a signal outside of the run
            raise
        run: Run = error.run
        return run


def _warn(words: str, page: LivePage | None) -> None:
    typer.echo(f"vcfbench: warning: {words}", err=True)
    if page is not None:
        page.view.say(0.0, words, "warning")


def _progress(
    options: RunOptions, beginning: Beginning, page: LivePage | None, control: RunControl | None
) -> NoProgress:
    shown = _display(options, beginning, page)
    if control is not None:
        control.tell(shown.hear)
    return shown


def _display(options: RunOptions, beginning: Beginning, page: LivePage | None) -> NoProgress:
    if page is not None:
        page.begin(beginning)
    estimate_s = beginning.planned.bench_seconds
    if options.quiet:
        return NoProgress()
    from vcfbench.reports.progress import LineProgress, LiveProgress  # noqa: PLC0415

    if options.plain or not sys.stderr.isatty() or os.environ.get("TERM") in _WITHOUT_CURSOR:
        return LineProgress(sys.stderr, estimate_s)
    return LiveProgress(sys.stderr, estimate_s, beginning.points)


def _show(run: Run, options: RunOptions) -> None:
    """Print the answer: one JSON object, or table, fits and record."""
    if options.json:
        print_json(run.as_json())
    elif run.physical_minimum_s is not None:  # the bench did open
        print_report(run.report())
        for said in run.asked_again:
            typer.echo(f"\nasked again: {said}")
        typer.echo(
            f"\n{run.status.value}: {run.bench_seconds or 0.0:.1f} s of bench time, "
            f"{run.physical_minimum_s:.1f} s of it windows, ramps and settling"
        )
        if run.directory is not None:
            typer.echo(f"record: {run.directory}")
        if run.device_entry is not None:
            typer.echo(f"device: {run.device_entry}")


def _dry_run(procedure: AnyProcedure, settings: Layer, options: RunOptions) -> None:
    try:
        metadata = metadata_of(options.metadata)
        request = Request(procedure, options.bench, options.seed, settings, speed=options.speed, metadata=metadata)
        planned = prepare(request, Checked()).planned()
    except BenchError as error:
        if options.json:
            print_json({"procedure": procedure.name, "dry_run": True, "error": str(error)})
        raise
    if options.json:
        print_json(_dry_run_json(planned))
        return
    for each in planned.steps:
        typer.echo(f"{each.number:4d}  {each.t_s:8.1f} s  {each.step.describe()}")
    typer.echo("\n".join(_expected_lines(planned.expected)))
    typer.echo(
        f"estimated bench time {planned.bench_seconds:.0f} s, {planned.physical_minimum_s:.0f} s of it windows, "
        "ramps and settling"
    )


def _expected_lines(expected: Expectation) -> Iterator[str]:
    """Yield for each result its expected U95, and the contributions to it."""
    if expected.why_none is not None:
        yield f"expected U95: not known before the run: {expected.why_none}"
        return
    yield f"expected with {expected.noise}:"
    for each in expected.values:
        causes = ", ".join(f"{source} {u:.2g}" for source, u in each.causes)
        yield f"  {each.name}: U95 {each.u95:.2g} {each.unit}".rstrip() + (f"; u of {causes}" if causes else "")
    for why in dict.fromkeys(why for _, why in expected.unknown):
        names = ", ".join(name for name, of in expected.unknown if of == why)
        yield f"  not known before the run: {names}: {why}"


def _dry_run_json(planned: DryRun) -> dict[str, Any]:
    return {
        "procedure": planned.procedure,
        "dry_run": True,
        "estimated_bench_seconds": planned.bench_seconds,
        "physical_minimum_s": planned.physical_minimum_s,
        "steps": [
            {"n": each.number, "t_s": each.t_s, "kind": type(each.step).__name__, "what": each.step.describe()}
            for each in planned.steps
        ],
        "expected": to_builtins(planned.expected),
    }
