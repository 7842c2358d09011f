"""``vcfbench talk``: the bench at a prompt, in words of its own or in those of its instruments."""

import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated

import typer

from vcfbench.bench.bench import open_bench
from vcfbench.bench.console import ConsoleReply, summary
from vcfbench.cli.options import Bench_, Runs_, Seed_, Trace_, flag, option, tracing
from vcfbench.cli.person import agreed, at_the_terminal
from vcfbench.errors import Aborted, BenchError, ConfigError, NotSafe, PlanError
from vcfbench.records.raw import RawRecord
from vcfbench.runs.by_hand import ALIASES, WORDS, ByHand
from vcfbench.safety.signals import StopSignals

try:
    import readline
except ImportError:  # Windows has none
    readline = None  # type: ignore[assignment]


@contextmanager
def history(name: str, candidates: Callable[[], Sequence[str]] = list) -> Iterator[None]:
    """Keep typed lines from one conversation to the next under `name`; TAB completes the first word of a line."""
    if readline is None:
        yield
        return
    state = os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else "XDG_STATE_HOME")
    try:
        path = (Path(state) if state else Path.home() / ".local" / "state") / "vcfbench" / name
    except RuntimeError:  # there is no home
        path = Path(tempfile.gettempdir()) / "vcfbench" / name
    readline.clear_history()
    with suppress(OSError):
        readline.read_history_file(path)
    before = readline.get_completer(), readline.get_completer_delims()

    def complete(text: str, state: int) -> str | None:
        fitting = [each for each in candidates() if each.startswith(text)] if readline.get_begidx() == 0 else []
        return f"{fitting[state]} " if state < len(fitting) else None

    readline.set_completer(complete)
    readline.set_completer_delims(" ")  # words have dots in them
    libedit = "libedit" in (readline.__doc__ or "")  # macOS
    readline.parse_and_bind("bind ^I rl_complete" if libedit else "tab: complete")
    try:
        yield
    finally:
        readline.set_completer(before[0])
        readline.set_completer_delims(before[1])
        readline.set_history_length(1000)
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            readline.write_history_file(path)


_RAW = "raw commands: nothing is compared with the limits of the bench file; each is written to {}"
_OWN = ("help", "quit")


class _Stop(Exception):
    """The conversation is over."""


def talk(
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
    raw: Annotated[bool, flag("Allow any command. Limits are not checked; raw.jsonl records each.", "--raw")] = False,
    runs: Runs_ = Path("runs"),
) -> None:
    """Talk to the bench, or to one of its instruments in its own language. All is left safe.

    power.on, multimeter.read, table.rate 10, v_vc.set 0.1, help; multimeter *IDN? is a question to one instrument.

    Answers go to stdout, everything else to stderr. Lines come from -c, else from stdin. The first that is refused or
    fails ends the command with exit code 3, unless a person types them.
    """
    lines = (line.rstrip("\r\n") for line in (command or sys.stdin))
    typed = not command and sys.stdin.isatty()
    if raw:
        _remark(_RAW.format(runs / "raw.jsonl"))
    with (
        tracing(trace),
        StopSignals() as signals,
        open_bench(bench, seed=seed, signals=signals, trust=agreed, operator=at_the_terminal(signals, None)) as opened,
    ):
        record = RawRecord(runs, opened.description.name) if raw else None
        by_hand = ByHand(opened, signals, _remark, raw=record, timeout_s=timeout)
        if typed:
            _converse(by_hand, signals)
            return
        with suppress(_Stop):
            for line in lines:
                if (refusal := signals.attend(lambda: _perform(by_hand, line))) is not None:  # noqa: B023  # run at once
                    raise BenchError(refusal, command=line.strip())


def _show(said: ConsoleReply) -> str | None:
    """Print the answer of an instrument; return its refusal."""
    if said.answer is not None:
        typer.echo(summary(said.answer))
    elif said.refusal is None:
        _remark("no error")
    return said.refusal


def _converse(by_hand: ByHand, signals: StopSignals) -> None:
    """Do the lines that a person types; one that is refused or fails is told, and the next taken."""
    bench = by_hand.bench
    _remark(f"{bench.description.title}: {', '.join(bench.instruments)}")
    _remark("help shows the words, TAB completes them; Ctrl-D and Ctrl-C leave, and make the bench safe")
    with history("talk-history", lambda: [*by_hand.names(), *_OWN]), suppress(_Stop):
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
            raise ConfigError(f"{name}: expected a command to send, as in {name} *IDN?")
        return _show(by_hand.raw(name, rest.strip()))
    else:
        roles = {word.name: word.role for word in WORDS}
        role = roles.get(name, ALIASES.get(name, name))
        if role in by_hand.bench.instruments:
            raise PlanError(f"{name!r}: the commands of {role} are not text, so they cannot be typed")
        if role in {*filter(None, roles.values())}:
            raise PlanError(f"{name!r}: bench {by_hand.bench.description.name} has no {role}")
        close = get_close_matches(name, [*by_hand.names(), *_OWN], n=1)
        raise PlanError(f"there is no command {name!r}{f' ({close[0]!r}?)' if close else ''}; help shows them")
    return None


def _remark(text: str) -> None:
    typer.echo(text, err=True)
