"""``vcfbench bench``: the instruments that answer, and the contents of a bench file."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from typing import Annotated, Any

import typer
from msgspec import to_builtins
from msgspec.structs import asdict, astuple

from vcfbench.bench.check import CheckedInstrument, CheckedWatchdog, check_bench
from vcfbench.cli import options
from vcfbench.cli.answer import answer, print_json
from vcfbench.cli.bench_new import new
from vcfbench.cli.options import Bench_, Json_, Trace_, flag, tracing
from vcfbench.cli.person import agreed, at_the_terminal
from vcfbench.errors import BenchError, PlanError
from vcfbench.procedures.bench_file import as_resolved, load_bench, resolved_text
from vcfbench.reports.text import left_table
from vcfbench.runs.able import what_would_run
from vcfbench.runs.needs import AS_SET
from vcfbench.station import discovery, file
from vcfbench.station.discovery import DiscoveredInstrument
from vcfbench.station.equipment import calibration_words

_CALIBRATION = ("inventory_number", "calibrated", "calibration_due", "certificate", "overdue")

app = typer.Typer(no_args_is_help=True, help="Make, show and check a bench.")

app.command("new")(new)


@app.command("discover")
def discover(
    library: options.Library_ = "@py",
    tries: options.Tries_ = None,
    timeout: options.AnswerTime_ = 1.0,
    trace: Trace_ = None,
    *,
    probe_serial: options.ProbeSerial_ = False,
    json: Json_ = False,
) -> None:
    """Ask every VISA resource for its identity, list the serial ports, and print lines for a bench file.

    Exit code 3 when a resource given with --try does not answer.
    """
    with tracing(trace):
        found = discovery.discover(library, tries or (), timeout_s=timeout, serial_probe=probe_serial)
    stanza = discovery.stanza(found)
    if json:
        ports = [
            {
                "port": each.port,
                "description": each.description,
                "asked": each.found is not None,
                **({} if each.found is None else asdict(each.found)),
            }
            for each in found.serial_ports
        ]
        asked = {"resources": found.resources, "serial_ports": ports, "tried": found.tried}
        print_json({"library": found.library, **asked, "stanza": stanza})
    else:
        for resource in (*found.resources, *found.tried):
            typer.echo(_answer_line(resource))
        for port in found.serial_ports:
            unasked = f"{port.port}: {port.description}, not queried (--probe-serial queries it)"
            typer.echo(unasked if port.found is None else _answer_line(port.found))
        if not (found.resources or found.tried or found.serial_ports):
            typer.echo("found no VISA resource and no serial port")
        if stanza.strip():
            typer.echo("\n# for a bench file (vcfbench bench show --template has the rest):\n")
            typer.echo(stanza.rstrip())
    silent = [each.resource for each in found.tried if each.answer is None]
    if silent:
        raise BenchError(f"no answer from {', '.join(silent)}")


def _answer_line(found: DiscoveredInstrument) -> str:
    if found.answer is None:
        return f"{found.resource}: {found.problem}"
    known = f"{found.model}" if found.model is not None else "not recognised"
    return f"{found.resource}: {known}, {found.answer}"


@app.command("show")
def show(
    bench: Bench_ = None,
    *,
    template: Annotated[
        bool, flag("Print a commented bench file for a real station, to be filled in.", "--template")
    ] = False,
    json: Json_ = False,
) -> None:
    """Show the bench as resolved: every key, defaults included."""
    if template:
        typer.echo(file.template(), nl=False)
        return

    description = load_bench(bench)
    if json:
        print_json(as_resolved(description))
    else:
        typer.echo(resolved_text(description), nl=False)


@app.command("check")
def check(bench: Bench_ = None, trace: Trace_ = None, *, json: Json_ = False) -> None:
    """Open every instrument, check its identity, error queue and faults, and leave everything safe.

    Also shows calibrations, limits and acceptance from the bench file, and which procedures can run here.
    """
    description, operator = load_bench(bench), at_the_terminal(None, None)
    if description.by_hand and operator is None:
        raise PlanError(
            f"bench check asks a person about {', '.join(description.by_hand)}, but no operator can be asked",
            hint="run it at a terminal",
        )
    with tracing(trace):
        done = check_bench(description, trust=agreed, operator=operator)

    def show() -> None:
        station: dict[str, Any] = {
            "wiring": description.rails_at,
            "limits": to_builtins(description.limits),
            "acceptance": to_builtins(description.acceptance),
            "procedures": what_would_run(description, done.not_ready()),
        }
        if json:
            safe = {report.instrument: report.safe for report in done.safe_reports}
            instruments = {
                each.role: {
                    "resource": each.resource,
                    "identity": to_builtins(each.identity),
                    "ok": each.problem is None,
                    "problem": each.problem,
                    "answers": each.answers,
                    "safe": safe.get(each.role),
                    **{key: each.equipment.as_json()[key] for key in _CALIBRATION},
                }
                for each in done.instruments
            }
            watchdog = {
                "ok": done.watchdog.problem is None,
                "ready_s": done.watchdog.ready_s,
                "problem": done.watchdog.problem,
                "instruments": {role: {"armed": False, "why": why} for role, why in done.watchdog.instruments.items()},
            }
            whole = {"bench": description.name, "ok": done.failure() is None}
            print_json({**whole, "watchdog": watchdog, "instruments": instruments, **station})
        else:
            header = ("role", "state", "model", "resource", "calibration", "who answers")
            typer.echo(f"{description.title}\n\n{left_table(header, map(_checked_row, done.instruments))}\n")
            for problem in filter(None, (each.problem for each in done.instruments)):
                typer.echo(problem)
            for each in filter(lambda each: each.answers, done.instruments):
                typer.echo(f"{each.role} answers: " + ", ".join(" ".join(pair) for pair in each.answers.items()))
            typer.echo(f"{left_table(('watchdog', 'state', ''), _watchdog_rows(done.watchdog))}\n")
            typer.echo(f"wiring: {station['wiring'] or 'no supply'}")
            for name, otherwise in (("limits", "none"), ("acceptance", "no result is judged")):
                given = {key: value for key, value in station[name].items() if value not in (None, "none")}
                said = ", ".join(f"{key} {_shown(value)}" for key, value in given.items())
                typer.echo(f"{name}: {said or otherwise}")
            not_ready = f"{', '.join(done.not_ready())} not ready" if done.not_ready() else ""
            typer.echo(_abilities(station["procedures"], not_ready or "each needs other instruments beside these"))

    answer(show, done.failure())


def _abilities(lacks: Mapping[str, str | None], none_because: str) -> str:
    """Say which procedures can run, and what the others lack: those together that lack the same."""
    able, others = [], defaultdict[str, list[str]](list)
    for name, lack in lacks.items():
        if lack is None:
            able.append(name)
        else:
            others[lack.removeprefix(f"{name} ")].append(name)
    if not able and not any(lack.startswith(AS_SET) for lack in others):
        return f"can run: no procedure: {none_because}"
    unable = (
        f"cannot run: {', '.join(names)}{': each ' if len(names) > 1 else ' '}{lack}" for lack, names in others.items()
    )
    return "\n".join([f"can run: {', '.join(able) or 'no procedure'}", *unable])


def _checked_row(each: CheckedInstrument) -> tuple[str, ...]:
    answered = "-" if each.identity is None else " ".join(filter(None, astuple(each.identity)))
    state = "ok" if each.problem is None else "FAILED"
    return each.called, state, str(each.equipment.model), each.resource, calibration_words(each.equipment), answered


def _shown(value: object) -> str:
    if isinstance(value, list | tuple):
        return " to ".join(map(_shown, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _watchdog_rows(watchdog: CheckedWatchdog) -> Iterator[tuple[str, str, str]]:
    if watchdog.problem is not None:
        yield "process", "FAILED", watchdog.problem
    elif watchdog.ready_s is None:
        yield "process", "none", "simulated in this process: nothing outlives it"
    else:
        yield "process", "ok", f"watches {watchdog.ready_s:.2f} s after its start"
    for role, why in watchdog.instruments.items():
        yield f"of {role} itself", "none", why
