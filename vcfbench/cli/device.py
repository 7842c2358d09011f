"""``vcfbench device``: history of a gyroscope by its serial number: certificates, self-calibrations, noise, runs."""

from collections import Counter, defaultdict
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer

from vcfbench.archive.amending import logged_in
from vcfbench.archive.batch_sheet import SheetRow, device_parts, device_rows
from vcfbench.archive.keeping import keep_of_device
from vcfbench.archive.summary import run_summaries
from vcfbench.cli.answer import print_json, print_verdicts
from vcfbench.cli.options import Devices_, Json_, Runs_, argument, flag, option
from vcfbench.devices.k_vc_change import sensitivity_table
from vcfbench.errors import ConfigError
from vcfbench.procedures.health.check import checked, health_parts
from vcfbench.records.devices import Device, DeviceStore, Entry, withdrawn
from vcfbench.records.schema import Status
from vcfbench.reports.document import Axis, Column, Figure, Report, Series, Table
from vcfbench.reports.plot import save_figure
from vcfbench.reports.text import printable, table_text, text_of
from vcfbench.values.kinds import KINDS

_COLUMNS = {
    "entry": Column("entry"),
    "kind": Column("kind", align="left"),
    "done": Column("done"),
    "scale_factor_v_per_deg_s": Column("scale factor of small signals", "V/(deg/s)", ".8f"),
    "u_scale_factor": Column("u", "V/(deg/s)", ".1e"),
    "bias_v": Column("output at rest", "V", ".6f"),
    "u_bias_v": Column("u", "V", ".1e"),
    "nonlinearity_ppm": Column("non-linearity, by V_Vc", "ppm", ".0f"),
    "drift_ppm": Column("drift", "ppm", "+.1f"),
    "u_drift_ppm": Column("u", "ppm", ".1f"),
    "e_n": Column("E_n", "", ".2f"),
    "cusum": Column("CUSUM", "", ".1f"),
    "verdict": Column("verdict"),
    "bias_instability_deg_h": Column("B", "deg/h", ".2f"),
    "u_bias_instability": Column("u", "deg/h", ".2f"),
}
"""Columns of the history, by their names in CSV."""
_MEASURED = {
    "scale_factor_v_per_deg_s": "u_scale_factor",
    "bias_v": "u_bias_v",
    "nonlinearity_ppm": None,
    "drift_ppm": "u_drift_ppm",
    "bias_instability_deg_h": "u_bias_instability",
}
"""Columns of measured values, and the column of the uncertainty where there is one."""

_OF_RUNS = {
    "scale_factor_v_per_deg_s": ("scale_factor_small", "u_scale_factor"),
    "bias_v": ("bias_at_rest", "u_bias_v"),
    "nonlinearity_ppm": ("nonlinearity_by_v_vc", None),
    "line_scale_factor_v_per_deg_s": ("scale_factor", "u_line_scale_factor"),
    "line_bias_v": ("bias", "u_line_bias_v"),
    "line_nonlinearity_ppm": ("nonlinearity", None),
}
"""The kinds of values of runs by their columns in CSV, those of lines on the table behind those of entries."""
_OF_STREAMS = {
    "line_scale_factor_v_per_deg_s": "line_scale_factor_of_unit_per_deg_s",
    "line_bias_v": "line_bias_of_unit",
}
"""Columns of lines by those in V: of a device whose output is a stream, in the unit of the row."""
_OF_LINES = (each for key, (_, u) in _OF_RUNS.items() if key not in _COLUMNS for each in (key, u) if each)
_CSV = (*_COLUMNS, *_OF_LINES, "unit", *_OF_STREAMS.values())

_UNITS_OF_TIME = (("d", 86_400.0), ("h", 3600.0), ("min", 60.0), ("s", 1.0))


def device_names(ctx: Any, incomplete: str) -> list[str]:
    """Return the serial numbers of the devices in the directory that the command line names so far, for a shell."""
    with suppress(Exception):
        serials = DeviceStore(Path(ctx.params.get("devices") or "devices")).serials()
        return [serial for serial in serials if serial.startswith(incomplete)]
    return []


def device(
    serial: Annotated[
        str | None, argument("SERIAL", "Serial number; without it, all are listed.", autocompletion=device_names)
    ] = None,
    devices: Devices_ = Path("devices"),
    *,
    json: Json_ = False,
    csv: Annotated[bool, flag("Print comma-separated values, one row for each entry and run.", "--csv")] = False,
    withdraw: Annotated[
        str | None, option("ENTRY", "Withdraw this entry: it stays in the history, but is not used.")
    ] = None,
    reason: Annotated[str, option("TEXT", "Why it is withdrawn.")] = "",
    by: Annotated[str | None, option("NAME", "Who withdraws it. Default: who is logged in.")] = None,
    add: Annotated[
        str | None, option("RUN", "Add the result of a complete run whose entry could not be written.")
    ] = None,
    runs: Runs_ = Path("runs"),
    plot: Annotated[
        Path | None, option("FILE", "Draw the scale factor against time: .png, .svg, .pdf (Matplotlib).")
    ] = None,
) -> None:
    """Show certificates, self-calibrations, static records and runs of a gyroscope, oldest first."""
    if add is not None:
        if serial is not None:
            raise ConfigError(f"SERIAL: leave {serial!r} out with --add: the record has the serial number")
        typer.echo(keep_of_device(add, runs, devices).path)
        return
    if withdraw is not None:
        typer.echo(_withdraw(DeviceStore(devices), serial, withdraw, reason, by))
        return
    if json and csv:
        raise ConfigError("--json and --csv: expected one of the two, got both")
    store = DeviceStore(devices)
    if serial is None:
        _list(store, runs, json=json)
        return
    calibrations = device_rows(serial, runs, devices)
    known = store.device(serial) if not calibrations or store.entries(serial) else Device(serial, ())
    entries = known.entries
    if plot is not None:
        _plot(serial, known.standing, calibrations, plot)
    if json:
        _print_json(known, calibrations)
    elif csv:
        _print_csv(known, calibrations)
    else:
        _print_history(known)
        if calibrations:
            print_verdicts("\n" * bool(entries) + text_of(Report(device_parts(calibrations))))


def _withdraw(store: DeviceStore, serial: str | None, entry: str, reason: str, by: str | None) -> Path:
    """Withdraw an entry and return the file that says so."""
    if serial is None:
        raise ConfigError("SERIAL: give the serial number of the device")
    return store.withdraw(serial, entry, reason=reason, by=by or logged_in()).path


def _print_json(known: Device, calibrations: Sequence[SheetRow]) -> None:
    since, counting = known.failed_since, known.standing
    entries = [
        {"entry": each.name, "counts": each in counting, **msgspec.to_builtins(each.record)} for each in known.entries
    ]
    print_json(
        {
            "serial": known.serial,
            "failed_since": None if since is None else since.name,
            "entries": entries,
            "runs": msgspec.to_builtins(calibrations),
        }
    )


def _print_csv(known: Device, calibrations: Sequence[SheetRow]) -> None:
    kept = {entry.run for entry in known.entries}
    typer.echo(",".join(_CSV))
    for row in [*_rows(known), *(_row_of_run(each) for each in calibrations if each.run not in kept)]:
        cells = map(row.get, _CSV)
        typer.echo(",".join(repr(each) if isinstance(each, float) else str(each or "") for each in cells))


def _print_history(known: Device) -> None:
    """Print the table of the entries, a failure of the device, and the promise of its last certificate."""
    if not (rows := _rows(known)):
        return
    table = Table([*_COLUMNS.values()], [tuple(row.values()) for row in rows], f"device {known.serial}")
    print_verdicts(table_text(table))
    for name, each in withdrawn(known.entries).items():
        typer.echo(f"\n{name} is withdrawn by {printable(each.by)}, {each.done:%Y-%m-%d}: {printable(each.reason)}")
    if known.failed_since is not None:
        print_verdicts(f"\n{_failed(known.failed_since)}")
    valid = known.certificate
    if valid is not None and valid.sensitivities:
        # Print until when the K_Vc of the last certificate is good, and its sensitivities
        when = "never" if valid.u95_until is None else f"on {valid.u95_until:%Y-%m-%d}"
        when = "before its certificate was out" if valid.beyond_u95 else when
        drift = f"drift of at most {valid.k_vc_drift_ppm_per_year or 0.0:g} ppm per year"
        typer.echo(f"\nU95 of K_Vc reaches {valid.wanted_u95_ppm:g} ppm {when} ({drift})\n")
        typer.echo(table_text(sensitivity_table(valid.sensitivities)))
    # Print the properties that the last self-calibration measured, beside the certificate's
    last = known.self_calibrations[-1] if known.self_calibrations else None
    named = {each.name: each.record for each in known.entries}
    certificate = None if last is None or last.certificate is None else named.get(last.certificate)
    then = getattr(certificate, "characteristics", None)
    if last is not None and last.characteristics is not None and then is not None:
        typer.echo("\n" + text_of(Report(health_parts(checked(then, last.characteristics)))))


_ENTRIES = "certificates and self-calibrations"


def _plot(serial: str, entries: tuple[Entry, ...], calibrations: Sequence[SheetRow], path: Path) -> None:
    """Draw the scale factor of each entry, and of each run by its procedure, over time.

    In ppm, against the first of its kind: the slope of a line is none of small signals, and lines are compared over
    the rates that they share.

    Behind the name of each stands E_n of its last one: against the certificate, or the run before.
    """
    shown: list[Entry | SheetRow] = [*entries, *calibrations]
    real = not all(each.simulated for each in shown)
    entries = tuple(each for each in entries if not (real and each.simulated))
    calibrations = [each for each in calibrations if not (real and each.simulated)]
    found = defaultdict[str, list[tuple[datetime, float, float]]](list)
    kept, last_e_n, kinds = set(), dict[str, float | None](), {_ENTRIES: "scale_factor_small"}
    for entry in entries:
        if (scale := getattr(entry.record, "scale_factor_v_per_deg_s", None)) is not None:
            found[_ENTRIES].append((entry.done, scale.value, scale.u))
            last_e_n[_ENTRIES] = getattr(entry.record, "e_n", None)
            kept.add(entry.run)
    left_out, first_line = 0, None
    unit_of_all = (
        "V/(deg/s)" if found else next((slope.unit for each in calibrations if (slope := each.scale_factor)), "")
    )
    for each in calibrations:
        slope = each.scale_factor
        if each.run not in kept and slope is not None and slope.value:
            value = slope.value
            if slope.unit != unit_of_all:
                left_out += 1
                continue
            if slope.kind == "scale_factor":
                first_line = value if first_line is None else first_line
                if each.since_first_ppm is None:
                    left_out += 1
                    continue
                value = first_line * (1.0 + 1e-6 * each.since_first_ppm)
            found[each.procedure].append((each.started, value, slope.u or 0.0))
            last_e_n[each.procedure], kinds[each.procedure] = each.e_n, slope.kind
    known = sorted(point for points in found.values() for point in points if point[1])
    if not known:
        raise ConfigError(f"device {serial}: no entry and no run has a scale factor to draw")
    begun, first = known[0][0], dict[str, float]()
    for _, value, name in sorted((done, value, name) for name, points in found.items() for done, value, _ in points):
        first.setdefault(kinds[name], value)
    took_s = (known[-1][0] - begun).total_seconds()
    unit, unit_s = next((each for each in _UNITS_OF_TIME if took_s >= 2.0 * each[1]), _UNITS_OF_TIME[-1])
    since = Axis(f"time since {begun:{'%Y-%m-%d' if unit == 'd' else '%Y-%m-%d %H:%M:%S UTC'}}", unit)
    series = [
        Series(
            name if last_e_n[name] is None else f"{name}, E_n {last_e_n[name]:.2f}",
            [(done - begun).total_seconds() / unit_s for done, _, _ in points],
            [1e6 * (value / first[kinds[name]] - 1.0) for _, value, _ in points],
            [1e6 * u / abs(first[kinds[name]]) for _, _, u in points],
        )
        for name, points in found.items()
    ]
    of = f" ({series[0].label})" if len(series) == 1 else ""  # several have a legend
    said = f"Left out, as their units, rates or conditions are not comparable: {left_out}." if left_out else ""
    title = f"Scale factor of {serial}{of}; bars: 2 u"
    save_figure(Figure(title, since, Axis("change", "ppm"), series, caption=said), path)


def _list(store: DeviceStore, runs: Path, *, json: bool) -> None:
    lines, failed = [], {}
    found = run_summaries(runs, status=Status.COMPLETE)
    ran = Counter(each.dut for each in found if each.dut and "," not in each.dut)  # each of several has its own record
    serials = sorted({*store.serials(), *ran})
    for serial in serials:
        if serial not in store.serials():
            lines.append(f"{printable(serial)}  no entry, complete runs: {ran[serial]}")
            continue
        try:
            since = store.device(serial).failed_since
        except ConfigError as error:  # the others are listed all the same
            lines.append(f"{serial}  cannot be read: {error}")
            continue
        lines.append(serial if since is None else f"{serial}  {_failed(since)}")
        if since is not None:
            failed[serial] = since.name
    if json:
        print_json({"devices": serials, "failed_since": failed})
    else:
        print_verdicts("\n".join(lines) or f"no devices in {store.root} or in the runs in {runs}")


def _failed(since: Entry) -> str:
    """Say that a device has failed, and until when."""
    name = f"{since.name}{' (simulated)' * since.simulated}"
    return f"FAILED since entry {name}: its drift, until a rate table gives it a new certificate"


def _rows(known: Device) -> list[dict[str, Any]]:
    """Return the entries by the names of the columns; those that do not count are marked."""
    counting, gone = {each.name for each in known.standing}, withdrawn(known.entries)
    marks = {
        name: "withdrawn" if name in gone else "simulated"
        for each in known.entries
        if (name := each.name) not in counting
    }
    return [_row(each, marks.get(each.name, "")) for each in known.entries]


def _row(entry: Entry, mark: str) -> dict[str, Any]:
    """Return an entry by the names of the columns, with the `mark` of one that does not count; None: no such value."""
    record = entry.record
    row: dict[str, Any] = dict.fromkeys(_COLUMNS)
    kind = f"{record.__struct_config__.tag}{f' ({mark})' if mark and entry.run is not None else ''}"
    row |= {"entry": entry.name, "kind": kind, "done": entry.done.isoformat(timespec="seconds")}
    for key, u in _MEASURED.items():
        found = getattr(record, key, None)
        if found is not None:
            row |= {key: found.value} if u is None else {key: found.value, u: found.u}
    return row | {key: getattr(record, key, None) for key in ("e_n", "cusum", "verdict")}


def _row_of_run(run: SheetRow) -> dict[str, Any]:
    """Return a run that is no entry by the names of the columns."""
    row: dict[str, Any] = {name: getattr(run, name, None) for name in ("drift_ppm", "u_drift_ppm", "e_n", "verdict")}
    row |= {"entry": run.run, "kind": run.procedure, "done": run.started.isoformat(timespec="seconds")}
    for key, (kind, u) in _OF_RUNS.items():
        found = next((each for each in run.values if each.kind == kind), None)
        if found is not None and (found.unit == KINDS[kind].si or key in _OF_STREAMS):
            other = found.unit != KINDS[kind].si
            row |= {_OF_STREAMS[key] if other else key: found.value} | ({} if u is None else {u: found.u})
            row |= {"unit": found.unit} if key == "line_bias_v" else {}
    return row
