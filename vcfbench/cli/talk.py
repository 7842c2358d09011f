"""``vcfbench talk``: the whole bench at one prompt, or one of its instruments in its own language."""

import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any

import typer

from vcfbench.bench.bench import open_bench
from vcfbench.bench.console import Console, ConsoleReply, data_of, open_console, summary
from vcfbench.cli.options import Bench_, Runs_, Seed_, Trace_, argument, flag, option, tracing
from vcfbench.cli.person import agreed
from vcfbench.cli.prompt import history
from vcfbench.errors import Aborted, BenchError, ConfigError, LimitError, NotSafe, PlanError, TransportError
from vcfbench.procedures.bench_file import load_bench
from vcfbench.records.raw import RawRecord
from vcfbench.runs.by_hand import ALIASES, WORDS, ByHand
from vcfbench.safety.roles import filled_roles
from vcfbench.safety.signals import Interrupted, StopSignals
from vcfbench.station.file import read_bench

_HELP = """\
Each line is sent as typed: questions; with --raw commands too, which are compared with no limit and written down.
.wait SECONDS   let bench time pass
.errors         read the error queue
.clear          device clear: end what the instrument is doing; Ctrl-C while an answer is awaited does the same
.save FILE      write the last answer to a file, of a block its data
.quit           leave; the instrument is made safe"""
_RAW = "raw commands: nothing is compared with the limits of the bench file; each is written to {}"
_OWN = ("help", "quit")


class _Stop(Exception):
    """The conversation is over."""


def role_names(ctx: Any, incomplete: str) -> list[tuple[str, str]]:
    """Return the roles of the bench that the command line names so far, with their instruments, for a shell."""
    with suppress(Exception):
        description = load_bench(ctx.params.get("bench"))
        names = [role.name for role in filled_roles(description)]
        return [(name, getattr(description, name).resource) for name in names if name.startswith(incomplete)]
    return []


def talk(
    role: Annotated[
        str | None,
        argument(
            None, "power, rate_source, multimeter, rate_table ... Default: the whole bench.", autocompletion=role_names
        ),
    ] = None,
    bench: Bench_ = None,
    seed: Seed_ = None,
    command: Annotated[
        list[str] | None, option("LINE", "Send this line and exit. Repeatable.", "--command", "-c")
    ] = None,
    timeout: Annotated[
        float | None, option("S", "Longest wait for an answer (bench file: timeout_s).", min=0.001)
    ] = None,
    *,
    trace: Trace_ = None,
    raw: Annotated[
        bool, flag("Send commands too, compared with no limit; each is written to raw.jsonl.", "--raw")
    ] = False,
    runs: Runs_ = Path("runs"),
) -> None:
    """Talk to the bench, or to one instrument in its own language. All that was opened is left safe.

    power.on, multimeter.read, table.rate 10, v_vc.set 0.1, help; multimeter *IDN? is a question to one instrument.

    Answers go to stdout, everything else to stderr. Lines come from -c, else from stdin. The first that is refused or
    fails ends the command with exit code 3, unless a person types them.
    """
    lines = (line.rstrip("\r\n") for line in (command or sys.stdin))
    typed = not command and sys.stdin.isatty()
    if raw and role is None:
        _remark(_RAW.format(runs / "raw.jsonl"))
    with tracing(trace):
        if role is None:
            with StopSignals() as signals, open_bench(bench, seed=seed, signals=signals, trust=agreed) as opened:
                record = RawRecord(runs, opened.description.name) if raw else None
                by_hand = ByHand(opened, signals, _remark, raw=record, timeout_s=timeout)
                if typed:
                    _converse_with_bench(by_hand, signals)
                else:
                    _recite(lambda line: signals.attend(lambda: _perform(by_hand, line)), lines)
            return
        described = read_bench(bench)
        record = RawRecord(runs, described.name) if raw else None
        with open_console(role, described, seed=seed, timeout_s=timeout, raw=record, trust=agreed) as console:
            if record is not None:
                _remark(_RAW.format(record.path))
            if typed:
                _converse(console)
            else:
                _recite(_Conversation(console).perform, lines, console)


def _recite(perform: Callable[[str], str | None], lines: Iterable[str], console: Console | None = None) -> None:
    """Do prepared lines; the first that is refused or fails ends it."""
    with suppress(_Stop):
        for line in lines:
            if (refusal := perform(line)) is not None:
                where, resource = (None, None) if console is None else (console.role, console.resource)
                raise BenchError(refusal, command=line.strip(), instrument=where, resource=resource)


def _show(said: ConsoleReply) -> str | None:
    """Print what an instrument answered; return its refusal."""
    if said.answer is not None:
        typer.echo(summary(said.answer))
    elif said.refusal is None:
        _remark("no error")
    return said.refusal


# One instrument


def _converse(console: Console) -> None:
    """Send the lines that a person types; one that is refused or fails is told, and the next taken."""
    identity = console.identity
    who = f"{identity.maker} {identity.model}, {identity.serial}, {identity.firmware}"
    _remark(f"{console.role} at {console.resource}: {who}")
    _remark("lines are sent as typed; .help shows what else there is, Ctrl-D leaves")
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
                try:
                    console.clear()
                except TransportError as error:
                    _remark(str(error))
                else:
                    _remark("broken off by a device clear")
            except (LimitError, ConfigError, TransportError) as error:
                _remark(str(error))
    raise BenchError("the connection is gone", instrument=console.role, resource=console.resource)


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
        if not text.startswith("."):
            said = self._console.say(text)
            self._answer = self._answer if said.answer is None else said.answer
            return _show(said)
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
        return None

    def _save(self, name: str) -> None:
        """Write the last answer to a file."""
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
    with suppress(ValueError):
        if 0.0 <= (seconds := float(text)) <= 86_400.0:
            return seconds
    raise ConfigError(f".wait {text}: expected seconds, from 0 to 86400")


# The whole bench


def _converse_with_bench(by_hand: ByHand, signals: StopSignals) -> None:
    """Do the lines that a person types; one that is refused or fails is told, and the next taken."""
    bench = by_hand.bench
    _remark(f"{bench.description.title}: {', '.join(bench.instruments)}")
    _remark("help shows the words, TAB completes them; Ctrl-D and Ctrl-C leave, and make the bench safe")
    with history("talk-bench-history", lambda: [*by_hand.names(), *_OWN]), suppress(_Stop):
        while True:
            try:
                line = signals.attend(lambda: input(f"{bench.description.name}> "))
                # a stop in the middle of an exchange is one at once: nothing waits for an answer, the table least
                refusal = signals.attend(lambda: _perform(by_hand, line))  # noqa: B023  # run at once
                if refusal is not None:
                    _remark(refusal)
            except EOFError:
                return
            except (Aborted, NotSafe):
                raise
            except BenchError as error:
                _remark(str(error))


def _perform(by_hand: ByHand, line: str) -> str | None:
    """Do the command of a line; return an instrument's refusal."""
    name, _, rest = line.strip().partition(" ")
    name = name.removeprefix(".")
    if not name or name.startswith("//"):
        return None
    if name in {"quit", "exit"}:
        raise _Stop
    if name == "help":
        shown = [(" ".join((word.name, *word.takes)), word.means) for word in by_hand.words.values()]
        shown += [
            ("ROLE LINE", f"send a question as it is, with --raw anything: {', '.join(by_hand.consoles)}"),
            ("quit", "leave"),
        ]
        width = max(len(usage) for usage, _ in shown)
        _remark("\n".join(f"{usage:<{width}}  {means}" for usage, means in shown))
    elif name in by_hand.words:
        typer.echo(by_hand.perform(name, rest.split()) or "done")
    elif name in by_hand.names():
        if not rest.strip():
            raise ConfigError(f"{name}: expected what is to be sent, as in {name} *IDN?")
        return _show(by_hand.raw(name, rest.strip()))
    else:
        roles = {word.name: word.role for word in WORDS}
        role = roles.get(name, ALIASES.get(name, name))
        if role in by_hand.bench.instruments:
            raise PlanError(f"{name!r}: the language of {role} cannot be typed")
        if role in {*filter(None, roles.values())}:
            raise PlanError(f"{name!r}: bench {by_hand.bench.description.name} has no {role}")
        close = get_close_matches(name, [*by_hand.names(), *_OWN], n=1)
        raise PlanError(f"there is no word {name!r}{f' ({close[0]!r}?)' if close else ''}; help shows them")
    return None


def _remark(text: str) -> None:
    typer.echo(text, err=True)
