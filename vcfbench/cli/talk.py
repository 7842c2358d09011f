"""``vcfbench talk``: the whole bench at one prompt, or a small console on one of its instruments."""

from __future__ import annotations

import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vcfbench.bench.console import data_of, open_console, summary
from vcfbench.cli.options import (
    Bench_,  # typer reads them
    Runs_,
    Seed_,
    Trace_,
    tracing,
)
from vcfbench.cli.person import agreed
from vcfbench.cli.prompt import history
from vcfbench.cli.talk_bench import talk_to_bench
from vcfbench.errors import BenchError, ConfigError, LimitError, TransportError
from vcfbench.procedures.bench_file import load_bench
from vcfbench.records.raw import RawRecord
from vcfbench.safety.roles import filled_roles
from vcfbench.safety.signals import Interrupted
from vcfbench.station.file import read_bench

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.bench.console import Console

_HELP = """\
Each line is sent as typed: questions; with --raw commands too, which are compared with no limit and written down.
.wait SECONDS   let bench time pass
.errors         read the error queue
.clear          device clear: end what the instrument is doing; Ctrl-C while an answer is awaited does the same
.save FILE      write the last answer to a file, of a block its data
.quit           leave; the instrument is made safe"""

_RAW = "raw commands: nothing is compared with the limits of the bench file; each is written to {}"


class _Stop(Exception):
    """The conversation is over."""


def role_names(ctx: Any, incomplete: str) -> list[tuple[str, str]]:
    """Return the roles of the bench that the command line names so far, with their instruments, for a shell."""
    with contextlib.suppress(Exception):
        description = load_bench(ctx.params.get("bench"))
        names = [role.name for role in filled_roles(description)]
        return [(name, getattr(description, name).resource) for name in names if name.startswith(incomplete)]
    return []


def talk(
    role: Annotated[
        str | None,
        typer.Argument(
            autocompletion=role_names,
            help="power, rate_source, multimeter, rate_table ... Default: the whole bench.",
        ),
    ] = None,
    bench: Bench_ = None,
    seed: Seed_ = None,
    command: Annotated[
        list[str] | None, typer.Option("--command", "-c", metavar="LINE", help="Send this line and exit. Repeatable.")
    ] = None,
    timeout: Annotated[
        float | None,
        typer.Option("--timeout", metavar="S", min=0.001, help="Longest wait for an answer (bench file: timeout_s)."),
    ] = None,
    *,
    trace: Trace_ = None,
    raw: Annotated[
        bool, typer.Option("--raw", help="Send commands too, compared with no limit; each is written to raw.jsonl.")
    ] = False,
    runs: Runs_ = Path("runs"),
) -> None:
    """Talk to the bench, or to one instrument in its own language. All that was opened is left safe.

    power.on, multimeter.read, table.rate 10, v_vc.set 0.1, help; multimeter *IDN? is a question to one instrument.

    Answers go to stdout, everything else to stderr. Lines come from -c, else from stdin. The first that is refused or
    fails ends the command with exit code 3, unless a person types them.
    """
    if role is None:
        if raw:
            _remark(_RAW.format(runs / "raw.jsonl"))
        with tracing(trace):
            talk_to_bench(bench, seed, command, raw=runs if raw else None, timeout_s=timeout)
        return

    lines = iter(command) if command else None
    interactive = lines is None and sys.stdin.isatty()
    described = read_bench(bench)
    record = RawRecord(runs, described.name) if raw else None
    opened = open_console(role, described, seed=seed, timeout_s=timeout, raw=record, trust=agreed)
    with tracing(trace), opened as console:
        if record is not None:
            _remark(_RAW.format(record.path))
        if interactive:
            identity = console.identity
            who = f"{identity.maker} {identity.model}, {identity.serial}, {identity.firmware}"
            _remark(f"{console.role} at {console.resource}: {who}")
            _remark("lines are sent as typed; .help shows what else there is, Ctrl-D leaves")
            _converse(console)
        else:
            _recite(console, lines or _stdin())


def _stdin() -> Iterator[str]:
    for line in sys.stdin:
        yield line.rstrip("\r\n")


def _recite(console: Console, lines: Iterator[str]) -> None:
    """Say prepared lines; the first that is refused or fails ends it."""
    conversation = _Conversation(console)
    with contextlib.suppress(_Stop):
        for line in lines:
            refusal = conversation.perform(line)
            if refusal is not None:
                raise BenchError(refusal, instrument=console.role, resource=console.resource, command=line.strip())


def _converse(console: Console) -> None:
    """Send the lines that a person types; one that is refused or fails is told, and the next taken."""
    conversation = _Conversation(console)
    with history("talk-history"):
        while not console.closed:
            try:
                line = console.read_line(lambda: input(f"{console.role}> "))
                with console.interruptible():
                    refusal = conversation.perform(line)
                if refusal is not None:
                    _remark(refusal)
            except (EOFError, _Stop):
                return
            except Interrupted:
                _break_off(console)
            except (LimitError, ConfigError, TransportError) as error:
                _remark(str(error))
    raise BenchError("the connection is gone", instrument=console.role, resource=console.resource)


def _break_off(console: Console) -> None:
    """End the instrument's operation, after a Ctrl-C."""
    try:
        console.clear()
    except TransportError as error:
        _remark(str(error))
    else:
        _remark("broken off by a device clear")


class _Conversation:
    """Conversation with a console, line by line."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._answer: bytes | None = None

    def perform(self, line: str) -> str | None:
        """Do the command of a line; return the instrument's refusal."""
        text = line.strip()
        if not text or text.startswith("//"):
            return None
        if text.startswith("."):
            self._direct(text)
            return None

        said = self._console.say(text)
        if said.answer is not None:
            self._answer = said.answer
            typer.echo(summary(said.answer))
        elif said.refusal is None:
            _remark("no error")
        return said.refusal

    def _direct(self, text: str) -> None:
        """Do a command to the console itself."""
        word, _, rest = text.partition(" ")
        match word:
            case ".wait":
                self._console.wait(_seconds(rest))
            case ".errors":
                _remark(self._console.errors() or "no error")
            case ".clear":
                self._console.clear()
            case ".save":
                self._save(rest.strip())
            case ".help":
                _remark(_HELP)
            case ".quit" | ".exit":
                raise _Stop
            case _:
                raise ConfigError(f"{text!r}: there are .wait SECONDS, .errors, .clear, .save FILE, .help and .quit")

    def _save(self, name: str) -> None:
        if not name:
            raise ConfigError(".save: expected the name of a file")
        if self._answer is None:
            raise ConfigError(f".save {name}: no answer has come yet")
        data = data_of(self._answer)
        try:
            Path(name).write_bytes(data)
        except (OSError, ValueError) as error:
            raise ConfigError(f".save {name}: {getattr(error, 'strerror', None) or error}") from None
        _remark(f"{len(data)} bytes written to {name}")


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0.0 <= seconds <= 86_400.0:
        raise ConfigError(f".wait {text}: expected seconds, from 0 to 86400")
    return seconds


def _remark(text: str) -> None:
    typer.echo(text, err=True)
