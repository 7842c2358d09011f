"""``vcfbench run``: a procedure, from the bench file to the record and the table.

The commands are made of the procedures: those that come along, those that installed packages bring, and the one that a
file of one's own defines. A list of them imports none.
"""

from __future__ import annotations

import inspect
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from vcfbench.cli.ending import SignalsWithoutBench
from vcfbench.cli.options import (  # typer reads them
    Bench_,
    Json_,
    Page_,
    Plain_,
    Port_,
    Quiet_,
    Seed_,
    Speed_,
    Trace_,
    Yes_,
    tracing,
)
from vcfbench.errors import ConfigError, PlanError
from vcfbench.procedures.catalogue import PROCEDURES, is_file, procedure

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from vcfbench.procedures.keys import SettableKey
    from vcfbench.procedures.procedure import AnyProcedure


class Procedures(TyperGroup):
    """The group of procedures; an unknown one is answered with the list of those that there are."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the known procedures."""
        del ctx
        return list(PROCEDURES)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command of a procedure, which is imported for it; None when there is none of that name."""
        del ctx
        known = cmd_name in PROCEDURES or is_file(cmd_name)
        return _command(procedure(cmd_name), cmd_name) if known else None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command named by the first of `args`."""
        if args and not args[0].startswith("-") and args[0] not in PROCEDURES and not is_file(args[0]):
            raise PlanError(f"there is no procedure {args[0]!r}; known are {', '.join(PROCEDURES)}")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the names and titles, without importing a procedure."""
        del ctx
        with formatter.section("Commands"):
            rows = [(name, PROCEDURES.title(name)) for name in PROCEDURES]
            formatter.write_dl([*rows, ("FILE.py", "The procedure that a file of your own defines.")])


class ProcedureCommand(TyperCommand):
    """The command of one procedure; its help ends with the keys that can be set."""

    keys: tuple[SettableKey, ...] = ()

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write every key with its default, its range and its meaning."""
        super().format_epilog(ctx, formatter)
        with formatter.section("Settings (--set KEY=VALUE, or the bench file's [procedure])"):
            formatter.write_dl([_key_row(key) for key in self.keys])


def _key_row(key: SettableKey) -> tuple[str, str]:
    default = f"; default {key.default}" if key.default else ""
    return key.path, f"{key.meaning + ': ' if key.meaning else ''}{key.expected}{default}"


app = typer.Typer(cls=Procedures, no_args_is_help=True, help="Run a calibration procedure on a bench.")

DryRun_ = Annotated[
    bool, typer.Option("--dry-run", help="Print every step and the estimated bench time. Nothing is opened.")
]


def _directory(name: str | Path) -> Path:
    """Read the name of a directory; an empty one would be the working directory, which nobody means by it."""
    if not str(name).strip():
        raise ConfigError("--runs: expected a directory, came an empty name")
    return Path(name)


Runs_ = Annotated[Path, typer.Option("--runs", metavar="DIR", parser=_directory, help="Where the records go.")]
Set_ = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="One of the settings listed below. Repeatable."),
]

Dut_ = Annotated[
    str | None,
    typer.Option("--dut", metavar="SERIAL", help="Serial number of the device under test."),
]
Operator_ = Annotated[
    str | None, typer.Option("--operator", metavar="NAME", help="Who runs the procedure, for the record.")
]
Note_ = Annotated[str | None, typer.Option("--note", metavar="TEXT", help="Anything to remember, for the record.")]
Tag_ = Annotated[
    list[str] | None,
    typer.Option("--tag", metavar="KEY=VALUE", help="A tag, for the record and for lists. Repeatable."),
]
Ambient_ = Annotated[
    str | None,
    typer.Option(
        "--ambient-temperature-c",
        metavar="DEGC|chamber",
        help="Temperature of the room, for the record; chamber: read its sensor before air flows.",
    ),
]
Humidity_ = Annotated[
    float | None,
    typer.Option("--humidity-percent", metavar="PERCENT", help="Relative humidity of the room, for the record."),
]


def _common(
    bench: Bench_ = None,
    seed: Seed_ = None,
    runs: Runs_ = Path("runs"),
    speed: Speed_ = None,
    settings: Set_ = None,
    *,
    dut: Dut_ = None,
    operator: Operator_ = None,
    note: Note_ = None,
    tag: Tag_ = None,
    ambient_temperature_c: Ambient_ = None,
    humidity_percent: Humidity_ = None,
    context: typer.Context,
    trace: Trace_ = None,
    json: Json_ = False,
    dry_run: DryRun_ = False,
    quiet: Quiet_ = False,
    plain: Plain_ = False,
    page: Page_ = False,
    port: Port_ = 0,
    yes: Yes_ = False,
) -> None:
    """Take the options of every procedure's command; each has this signature, with its own options added."""


def _command(chosen: AnyProcedure, name: str) -> Any:
    """Return the command of a procedure."""
    from vcfbench.procedures.keys import settable_keys  # noqa: PLC0415

    keys = tuple(settable_keys(chosen.settings))
    own = {key.path: key.option for key in keys if key.option}
    texts = {key.path for key in keys if key.expected.startswith("a text")}  # a serial number may look like a number

    lists = {key.path for key in keys if key.expected.startswith("a list") and key.expected.endswith("texts")}

    def run(context: typer.Context, **options: Any) -> None:
        from vcfbench.cli.conduct import RunOptions, conduct  # noqa: PLC0415  # keeps ``vcfbench --help`` quick
        from vcfbench.cli.metadata import METADATA_OPTIONS, metadata_options  # noqa: PLC0415
        from vcfbench.cli.set_option import asked_by_command  # noqa: PLC0415

        given = {key: value for key in own if (value := options.pop(key)) is not None}
        given = {key: json.dumps(v) if key in texts or v is True else v for key, v in given.items()}
        settings = asked_by_command(options.pop("settings") or (), given, own, lists, texts)
        with tracing(options.pop("trace")):
            metadata = metadata_options({key: options.pop(key) for key in METADATA_OPTIONS})
            asked = RunOptions(**options, settings=settings.values, metadata=metadata)
            conduct(chosen, settings, asked, context.find_object(SignalsWithoutBench))

    _sign(run, {key.path: _option(own[key.path], key) for key in keys if key.option})
    alone = typer.Typer(add_completion=False, rich_markup_mode=None, pretty_exceptions_enable=False)
    alone.command(name, cls=ProcedureCommand, help=chosen.title)(run)
    command: Any = typer.main.get_command(alone)
    command.keys = keys
    return command


def _option(name: str, key: SettableKey) -> Any:
    if key.expected == "true or false":
        return Annotated[bool | None, typer.Option(name, help=_sentence(key.meaning))]
    metavar = key.expected.replace(" or ", "|").replace("'", "") if " or " in key.expected else "VALUE"
    return Annotated[str | None, typer.Option(name, metavar=metavar, help=_sentence(key.meaning))]


def _sentence(meaning: str) -> str:
    """Return `meaning` as a sentence; its symbols, such as K_Vc, stay as they are written."""
    return f"{meaning[:1].upper()}{meaning[1:]}."


def _sign(function: Callable[..., None], options: Mapping[str, Any]) -> None:
    """Give `function` the parameters that every command has, and `options` beside them; typer reads them there."""
    common = inspect.signature(_common, eval_str=True)
    parameters = [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in common.parameters.values()]
    parameters += [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
        for name, annotation in options.items()
    ]
    function.__signature__ = common.replace(parameters=parameters)  # type: ignore[attr-defined]
    function.__annotations__ = {each.name: each.annotation for each in parameters}
