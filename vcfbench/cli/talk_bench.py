"""``vcfbench talk`` without a role: the whole bench at one prompt."""

from __future__ import annotations

import sys
from contextlib import suppress
from difflib import get_close_matches
from typing import TYPE_CHECKING

import typer

from vcfbench.bench.bench import open_bench
from vcfbench.bench.console import summary
from vcfbench.cli.person import agreed
from vcfbench.cli.prompt import history
from vcfbench.errors import Aborted, BenchError, ConfigError, NotSafe, PlanError
from vcfbench.records.raw import RawRecord
from vcfbench.runs.by_hand import ALIASES, WORDS, ByHand
from vcfbench.safety.signals import StopSignals

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


_OWN = ("help", "quit")


class _Stop(Exception):
    """The conversation is over."""


def talk_to_bench(
    bench: Path | None, seed: int | None, lines: Iterable[str] | None, *, raw: Path | None, timeout_s: float | None
) -> None:
    """Open the whole bench and do the lines typed, or `lines`; it is made safe however it is left.

    Raw commands are recorded in the directory `raw`; None refuses them.
    """
    with StopSignals() as signals, open_bench(bench, seed=seed, signals=signals, trust=agreed) as opened:
        record = None if raw is None else RawRecord(raw, opened.description.name)
        by_hand = ByHand(opened, signals, _remark, raw=record, timeout_s=timeout_s)
        if lines is None and sys.stdin.isatty():
            _remark(f"{opened.description.title}: {', '.join(opened.instruments)}")
            _remark("help shows the words, TAB completes them; Ctrl-D and Ctrl-C leave, and make the bench safe")
            _converse(by_hand, signals)
        else:
            _recite(by_hand, signals, (line.rstrip("\r\n") for line in (sys.stdin if lines is None else lines)))


def _recite(by_hand: ByHand, signals: StopSignals, lines: Iterable[str]) -> None:
    """Do prepared lines; the first that is refused or fails ends it."""
    with suppress(_Stop):
        for line in lines:
            refusal = signals.attend(lambda: _perform(by_hand, line))  # noqa: B023  # run at once
            if refusal is not None:
                raise BenchError(refusal, command=line.strip())


def _converse(by_hand: ByHand, signals: StopSignals) -> None:
    """Do the lines that a person types; one that is refused or fails is told, and the next taken."""
    with history("talk-bench-history", lambda: [*by_hand.names(), *_OWN]), suppress(_Stop):
        while True:
            try:
                line = signals.attend(lambda: input(f"{by_hand.bench.description.name}> "))
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
        message = rest.strip()
        if not message:
            raise ConfigError(f"{name}: expected what is to be sent, as in {name} *IDN?")
        said = by_hand.raw(name, message)
        if said.answer is not None:
            typer.echo(summary(said.answer))
        elif said.refusal is None:
            _remark("no error")
        return said.refusal
    else:
        raise _unknown(by_hand, name)
    return None


def _unknown(by_hand: ByHand, name: str) -> PlanError:
    roles = {word.name: word.role for word in WORDS}
    role = roles.get(name, ALIASES.get(name, name))
    if role in {*filter(None, roles.values())}:
        if role in by_hand.bench.instruments:
            return PlanError(f"{name!r}: the language of {role} cannot be typed")
        return PlanError(f"{name!r}: bench {by_hand.bench.description.name} has no {role}")
    close = get_close_matches(name, [*by_hand.names(), *_OWN], n=1)
    return PlanError(f"there is no word {name!r}{f' ({close[0]!r}?)' if close else ''}; help shows them")


def _remark(text: str) -> None:
    typer.echo(text, err=True)
