"""``vcfbench run`` and ``vcfbench resume``: a procedure, from the bench file to the record and the table.

The commands of ``run`` are made of the procedures: those that come along, those that installed packages bring, and the
one in a custom file. A list of them imports none.
"""

import json as encoder
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

import typer
from msgspec import structs
from typer.core import TyperCommand, TyperGroup

from vcfbench.cli import conduct, options
from vcfbench.cli.ending import SignalsWithoutBench
from vcfbench.cli.options import flag, option
from vcfbench.cli.person import agreed
from vcfbench.cli.set_option import asked_by_command
from vcfbench.errors import ConfigError
from vcfbench.instructions.procedure import AnyProcedure
from vcfbench.procedures.catalogue import PROCEDURES, is_file, no_procedure, procedure
from vcfbench.procedures.keys import SettableKey, settable_keys
from vcfbench.records.metadata import metadata_of
from vcfbench.runs.request import Prepared, Request
from vcfbench.runs.resumed import Resumed, broken_off


class Procedures(TyperGroup):
    """The group of procedures; an unknown one is answered with the list of those that there are."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the known procedures."""
        return list(PROCEDURES)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command of a procedure, which is imported for it; None for an unknown name."""
        known = cmd_name in PROCEDURES or is_file(cmd_name)
        return _command(procedure(cmd_name), cmd_name) if known else None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command named by the first of `args`."""
        if args and not args[0].startswith("-") and args[0] not in PROCEDURES and not is_file(args[0]):
            raise no_procedure(args[0])
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the names and titles, without importing a procedure."""
        with formatter.section("Commands"):
            rows = [(name, PROCEDURES.title(name)) for name in PROCEDURES]
            formatter.write_dl([*rows, ("FILE.py", "The procedure that a file of your own defines.")])


_SECTIONS: Final = {
    "Settings": ("settings",),
    "Bench": ("bench", "seed", "speed", "trace"),
    "Before and during the run": ("dry_run", "yes", "quiet", "plain", "page", "port"),
    "Output": ("verbose", "json"),
    "Record": ("runs", "dut", "operator", "note", "tag", "ambient_temperature_c", "humidity_percent"),
    "Help": ("help",),
}
"""Headings of the help of a procedure, and the options below each."""


class ProcedureCommand(TyperCommand):
    """The command of one procedure; its help ends with the keys that can be set."""

    chosen: AnyProcedure
    keys: tuple[SettableKey, ...] = ()

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the options in groups, those of the procedure first."""
        rows = {each.name: row for each in self.get_params(ctx) if (row := each.get_help_record(ctx)) is not None}
        common = {name for names in _SECTIONS.values() for name in names}
        own = [row for name, row in rows.items() if name not in common]
        for heading, names in _SECTIONS.items():
            with formatter.section(heading):
                formatter.write_dl([*(own if heading == "Settings" else ()), *(rows[name] for name in names)])

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write every key with its default, its range and its meaning."""
        super().format_epilog(ctx, formatter)
        with formatter.section("Settings (--set KEY=VALUE, or the bench file's [procedure])"):
            rows = [(key.path, f"{key.meaning}: " * bool(key.meaning) + key.expected, key.default) for key in self.keys]
            formatter.write_dl([(path, f"{words}; default {own}" if own else words) for path, words, own in rows])


app = typer.Typer(cls=Procedures, no_args_is_help=True, help="Run a calibration procedure on a bench.")


def _directory(name: str | Path) -> Path:
    """Read the name of a directory; an empty one would be the working directory, which nobody means by it."""
    if not str(name).strip():
        raise ConfigError("--runs: expected a directory, got an empty name")
    return Path(name)


def run(
    *,
    bench: options.Bench_ = None,
    seed: options.Seed_ = None,
    runs: Annotated[Path, option("DIR", "Where the records go.", parser=_directory)] = Path("runs"),
    speed: options.Speed_ = None,
    settings: Annotated[
        list[str] | None, option("KEY=VALUE", "One of the settings listed below. Repeatable.", "--set")
    ] = None,
    dut: Annotated[str | None, option("SERIAL", "Serial number of the device under test.")] = None,
    operator: Annotated[str | None, option("NAME", "Who runs the procedure, for the record.")] = None,
    note: Annotated[str | None, option("TEXT", "A note for the record.")] = None,
    tag: Annotated[list[str] | None, option("KEY=VALUE", "A tag, for the record and for lists. Repeatable.")] = None,
    ambient_temperature_c: Annotated[
        str | None,
        option("DEGC|chamber", "Temperature of the room, for the record; chamber: read its sensor before air flows."),
    ] = None,
    humidity_percent: Annotated[
        float | None, option("PERCENT", "Relative humidity of the room, for the record.")
    ] = None,
    context: typer.Context,
    trace: options.Trace_ = None,
    json: options.Json_ = False,
    dry_run: Annotated[
        bool, flag("Print every step and the estimated bench time. Nothing is opened.", "--dry-run")
    ] = False,
    quiet: options.Quiet_ = False,
    verbose: options.Verbose_ = False,
    plain: options.Plain_ = False,
    page: options.Page_ = False,
    port: options.Port_ = 0,
    yes: options.Yes_ = False,
    **own: Any,
) -> None:
    """Run the procedure of the command; `own` are the values of those of its keys that are options as well."""
    command: Any = context.command
    keys: tuple[SettableKey, ...] = command.keys
    names = {key.path: key.option for key in keys if key.option}
    texts = {key.path for key in keys if key.expected.startswith("a text")}  # a serial number may look like a number
    lists = {key.path for key in keys if key.expected.startswith("a list") and key.expected.endswith("texts")}
    given = {
        key: encoder.dumps(value) if key in texts or value is True else value
        for key, value in own.items()
        if value is not None
    }
    asked = asked_by_command(settings or (), given, names, lists, texts)
    said: dict[str, Any] = {"dut": dut, "operator": operator, "note": note, "humidity_percent": humidity_percent}
    if ambient_temperature_c == "chamber":
        said["ambient_from"] = ambient_temperature_c
    elif ambient_temperature_c is not None:
        try:
            said["ambient_temperature_c"] = float(ambient_temperature_c)
        except ValueError:
            expected = "expected degC, as in 23.1, or chamber"
            raise ConfigError(f"--ambient-temperature-c {ambient_temperature_c}: {expected}") from None
    said["tags"] = options.tags_of(tag or ()) or None
    metadata = {name: value for name, value in said.items() if value is not None}
    with options.tracing(trace):
        request = Request(command.chosen, bench, seed, asked, speed=speed)
        if dry_run:
            conduct.show_plan(request, metadata, as_json=json)
            return
        request = structs.replace(request, runs=runs, metadata=metadata_of(metadata))
        how = conduct.RunOptions(
            bench=bench, json=json, runs=runs, speed=speed, quiet=quiet, plain=plain, page=page, port=port, yes=yes
        )
        how = structs.replace(how, verbose=verbose, seed=seed, settings=asked.values, metadata=metadata)
        conduct.carry_out(request, Prepared, how, context.find_object(SignalsWithoutBench))


def _command(chosen: AnyProcedure, name: str) -> Any:
    """Return the command of a procedure: the options of `run`, and those of its own keys after them."""
    keys = tuple(settable_keys(chosen.settings))
    own: dict[str, Any] = {}
    for key in keys:
        if key.option:
            meaning = f"{key.meaning[:1].upper()}{key.meaning[1:]}."  # its symbols, such as K_Vc, stay as they are
            metavar = key.expected.replace(" or ", "|").replace("'", "") if " or " in key.expected else "VALUE"
            if key.expected == "true or false":
                own[key.path] = Annotated[bool | None, flag(meaning, key.option)]
            else:
                own[key.path] = Annotated[str | None, option(metavar, meaning, key.option)]
    alone = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    alone.command(name, cls=ProcedureCommand, help=chosen.title)(options.with_options(run, own))
    command: Any = typer.main.get_command(alone)
    command.chosen, command.keys = chosen, keys
    return command


def resume(
    run: options.Run_,
    bench: Annotated[
        Path | None, option("FILE", "Bench file, if the bench of the run has other addresses now.")
    ] = None,
    procedure: Annotated[
        Path | None, option("FILE", "Procedure file, if that of the run was moved or changed.")
    ] = None,
    runs: options.Runs_ = Path("runs"),
    *,
    context: typer.Context,
    trace: options.Trace_ = None,
    speed: options.Speed_ = None,
    json: options.Json_ = False,
    quiet: options.Quiet_ = False,
    verbose: options.Verbose_ = False,
    plain: options.Plain_ = False,
    page: options.Page_ = False,
    port: options.Port_ = 0,
    yes: options.Yes_ = False,
) -> None:
    """Resume a run that failed, or was stopped or killed. Recorded steps are copied; the record is new."""
    how = conduct.RunOptions(
        bench=bench, json=json, runs=runs, speed=speed, quiet=quiet, plain=plain, page=page, port=port, yes=yes
    )
    how = structs.replace(how, verbose=verbose)
    with options.tracing(trace):
        broken = broken_off(run, runs)
        if procedure is None:
            broken.require_trust(yes or agreed)
        beside = broken.directory.path.parent
        request = Request(procedure or broken.procedure, bench, runs=beside, speed=speed)
        with broken.directory.alone():
            conduct.carry_out(request, partial(Resumed, broken), how, context.find_object(SignalsWithoutBench))
