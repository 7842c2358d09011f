"""Runs as the command line asks for them: options handed on, the run shown as it goes, the answer printed."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import typer
from msgspec import Struct, field, structs, to_builtins

from vcfbench.archive.run import Run
from vcfbench.cli.answer import given, not_seen, print_json, print_not_seen, print_report
from vcfbench.cli.ending import SignalsWithoutBench
from vcfbench.cli.keys import Keys
from vcfbench.cli.person import agreed, at_the_terminal, somebody_there
from vcfbench.errors import BenchError, SettingChanged
from vcfbench.records.metadata import metadata_of
from vcfbench.records.schema import Status
from vcfbench.reports.document import Report
from vcfbench.reports.progress import LineProgress
from vcfbench.reports.shielded import NoProgress
from vcfbench.runs.conduct import conduct as conducted
from vcfbench.runs.request import Prepared, Preparing, Request, prepare
from vcfbench.safety.control import RunControl
from vcfbench.safety.signals import StopSignals
from vcfbench.values.printing import incomplete

if TYPE_CHECKING:
    from vcfbench.page.server import LivePage

_SCREEN: Final = 80  # Characters of a line of the short answer
_WITHOUT_CURSOR: Final = frozenset({"dumb", "unknown"})
"""Terminals on which nothing can be drawn in place, by the name that they give themselves."""


class RunOptions(Struct, frozen=True, kw_only=True):
    """Options of a run on the command line, as the record keeps them."""

    bench: Path | None
    seed: int | None = None
    json: bool = False
    dry_run: bool = False
    runs: Path
    speed: str | None = None
    quiet: bool = False
    verbose: bool = False
    plain: bool = False
    page: bool = False
    port: int = 0
    yes: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)
    metadata: Mapping[str, Any] = field(default_factory=dict)

    @property
    def has_keys(self) -> bool:
        """True if a person can press keys here, and sees their effect; Windows has no such terminal."""
        return os.name == "posix" and not self.quiet and somebody_there() and sys.stderr.isatty()


def carry_out(request: Request, preparing: Preparing, options: RunOptions, ending: SignalsWithoutBench | None) -> None:
    """Conduct a run: its output goes to stdout, errors are raised for the caller to print.

    `ending` is told when the code is known, while signals are still held: what comes later shall not change it.
    """
    control = RunControl() if options.page or options.has_keys else None
    page: LivePage | None = None
    with ExitStack() as stack:
        signals = stack.enter_context(StopSignals())  # until all is written: a second Ctrl-C shall not cost the results
        if options.page and control is not None:
            from vcfbench.page.server import LivePage  # noqa: PLC0415  # few look at one

            devices = Path("devices" if request.settings is None else request.settings.values.get("devices", "devices"))
            page = LivePage(request.runs or options.runs, devices, options.port)
            page.follow(control)
            typer.echo(f"page: {page.address}", err=True)
            stack.enter_context(page)
        run = attended(structs.replace(request, control=control), preparing, options, signals, page)
        if page is not None:
            page.ended(run)
        unwritten = given(lambda: _show(run, options))
        if ending is not None:
            ending.answered()
    if run.error is not None:
        raise run.error
    if ended := {each.metadata.dut or "": each.error for each in run.devices if each.error is not None}:
        error = BenchError.joined(ended)
        error.what = f"{len(ended)} of {len(run.devices)} devices ended early, the others finished: {error.what}"
        raise error
    if any(each.verdict is not None and not each.verdict.passed for each in (run, *run.devices)):
        raise typer.Exit(1)  # no error: a limit of the results failed, whether or not anybody could read it
    if unwritten is not None:
        unwritten.hint = None if run.directory is None else f"it is in the record {run.directory}"
        raise unwritten


def attended(
    request: Request, preparing: Preparing, options: RunOptions, signals: StopSignals, page: LivePage | None
) -> Run:
    """Return the run, also after an error; keys typed at the terminal pause it or let it continue."""
    control = request.control

    def warn(words: str) -> None:
        typer.echo(f"vcfbench: warning: {words}", err=True)
        if page is not None:
            page.view.say(0.0, words, "warning")

    def display(prepared: Prepared) -> NoProgress:
        if page is not None:
            page.begin(prepared)
        estimate_s, unit = prepared.planned().bench_seconds, prepared.settings.station.output_unit
        shown = NoProgress()
        if not options.quiet:
            if (
                options.plain
                or prepared.description.by_hand
                or not sys.stderr.isatty()
                or os.environ.get("TERM") in _WITHOUT_CURSOR
            ):
                shown = LineProgress(sys.stderr, estimate_s, unit)
            else:
                from vcfbench.reports.live_progress import LiveProgress  # noqa: PLC0415  # rich comes with it

                shown = LiveProgress(sys.stderr, estimate_s, prepared.points(), unit)
        if control is not None:
            control.tell(shown.hear)
        return shown

    try:
        with nullcontext() if control is None or not options.has_keys else Keys(control) as keys:
            watched = structs.replace(
                request,
                display=display,
                observers=() if page is None else (page.view,),
                person=request.person or at_the_terminal(signals, keys, yes=options.yes),
                options={key: each for key, each in structs.asdict(options).items() if key != "verbose"},
                warn=warn,
                trust=options.yes or (lambda words: agreed(words, signals, keys)),
            )
            return conducted(watched, signals, preparing)
    except BenchError as error:
        if error.run is None:  # a signal outside of the run
            raise
        run: Run = error.run
        return run


def _show(run: Run, options: RunOptions) -> None:
    """Print the answer: one JSON object, or table, fits and record."""
    if options.json:
        # of a simulated run it would take longer than the run: `runs show` has it
        print_json({**run.as_json(), "not_seen": None if run.simulated else not_seen(run)})
    elif run.physical_minimum_s is not None:  # the bench did open
        _print_answer(run, options)
        for said in run.asked_again:
            typer.echo(f"\nquery repeated: {said}")
        if not run.simulated:
            print_not_seen(run)
        typer.echo(
            f"\n{run.status.value}: {run.bench_seconds or 0.0:.1f} s of bench time, "
            f"{run.physical_minimum_s:.1f} s of it windows, ramps and settling"
        )
        if run.directory is not None:
            typer.echo(f"record: {run.directory}")
            if not options.verbose:
                last = run.devices[0].name if run.devices else "last"
                typer.echo(f"more: -v, vcfbench runs show {last} (points, budget), vcfbench report {last}")
            if (
                run.error is not None
                and run.status is not Status.COMPLETE
                and not isinstance(run.error, SettingChanged)
            ):
                typer.echo(f"the rest: vcfbench resume {run.name}, once the cause is removed")
        if run.device_entry is not None:
            typer.echo(f"device: {run.device_entry}")


def _print_answer(run: Run, options: RunOptions) -> None:
    """Print the values of a run on one screen; its whole report if asked for, or if it states no values."""
    from vcfbench.archive.brief import brief  # noqa: PLC0415  # loads what only an answer needs
    from vcfbench.archive.lot import lot_report  # noqa: PLC0415  # as above

    for each in run.devices if options.verbose else ():
        typer.echo(f"\ndevice {each.metadata.dut}")
        print_report(each.report())
    if run.devices:
        print_report(Report([*lot_report(run).parts, *run.remarks]))
        typer.echo("")
        for each in run.devices:
            typer.echo(f"{each.metadata.dut}: {each.directory or 'no record'}")
        return
    short = None if options.verbose or run.error is not None else brief(run)
    if short is None:
        print_report(run.report())
    else:
        print_report(short, _SCREEN)


def show_plan(request: Request, metadata: Mapping[str, Any], *, as_json: bool) -> None:
    """Print every step of a procedure, and the estimated bench time; nothing is opened."""
    prepared = prepare(structs.replace(request, metadata=metadata_of(metadata)))
    planned = prepared.planned()
    wired, devices = prepared.description.rails_at, list(prepared.description.several)
    if as_json:
        steps = [
            {"n": each.number, "t_s": each.t_s, "kind": type(each.step).__name__, "what": each.step.describe()}
            for each in planned.steps
        ]
        times = {"estimated_bench_seconds": planned.bench_seconds, "physical_minimum_s": planned.physical_minimum_s}
        expected = to_builtins(planned.expected)
        what = {**({"wiring": wired} if wired else {}), **({"devices": devices} if devices else {})}
        print_json(
            {"procedure": planned.procedure, "dry_run": True, **what, **times, "steps": steps, "expected": expected}
        )
        return
    if wired:
        typer.echo(f"wiring: {wired}")
    if devices:
        typer.echo(f"devices: {', '.join(devices)}; one that cannot be read or fails ends early, the others go on")
    for each in planned.steps:
        typer.echo(f"{each.number:4d}  {each.t_s:8.1f} s  {each.step.describe()}")
    expectation = planned.expected
    if expectation.why_none is not None:
        typer.echo(f"expected U95: not known before the run: {expectation.why_none}")
    else:
        typer.echo(f"expected with {expectation.noise}:")
    for value in expectation.values:
        causes = ", ".join(f"{source} {u:.2g}" for source, u in value.causes)
        u95 = f"  {value.name}: U95 {value.u95:.2g} {value.unit}".rstrip() + incomplete(value.missing)
        typer.echo(f"{u95}; u of {causes}" if causes else u95)
    for why in dict.fromkeys(why for _, why in expectation.unknown):
        names = ", ".join(name for name, of in expectation.unknown if of == why)
        typer.echo(f"  not known before the run: {names}: {why}")
    typer.echo(
        f"estimated bench time {planned.bench_seconds:.0f} s, {planned.physical_minimum_s:.0f} s of it windows, "
        "ramps and settling"
    )
