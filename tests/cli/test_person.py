"""Who is asked for what only hands can do: the person at a terminal, nobody with --yes, and else the run is refused."""

from __future__ import annotations

import io
import os
import signal
from typing import TYPE_CHECKING

import pytest

from vcfbench.cli.person import at_the_terminal
from vcfbench.errors import Aborted
from vcfbench.interfaces import Request
from vcfbench.safety.signals import StopSignals

if TYPE_CHECKING:
    from collections.abc import Callable

MOVE = Request("move the leads to the V_Vc input")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def asked(monkeypatch: pytest.MonkeyPatch, stdin: io.StringIO, *, yes: bool = False) -> Callable[[Request], str] | None:
    monkeypatch.setattr("sys.stdin", stdin)
    return at_the_terminal(StopSignals(), None, yes=yes)


def test_a_person_presses_enter(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    person = asked(monkeypatch, Terminal("\ndone by J. Smith\n"))
    assert person is not None
    assert person(MOVE) == "done"
    assert person(MOVE) == "done by J. Smith"
    assert capsys.readouterr().err.startswith("\nPlease move the leads to the V_Vc input, then press Enter: ")


def test_a_terminal_that_ends_stops_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    person = asked(monkeypatch, Terminal(""))
    assert person is not None
    with pytest.raises(Aborted, match="the terminal was closed during the request to move the leads"):
        person(MOVE)


def test_what_is_no_terminal_asks_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    assert asked(monkeypatch, io.StringIO("\n")) is None


def test_yes_takes_it_as_done_and_says_so(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    person = asked(monkeypatch, io.StringIO(""), yes=True)
    assert person is not None
    assert person(MOVE) == "counted as done: --yes"
    assert capsys.readouterr().err == "by hand: move the leads to the V_Vc input; counted as done (--yes)\n"


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="Windows has no pseudo-terminals")
def test_ctrl_c_while_it_waits_stops_the_run_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    class Pressed(Terminal):
        def readline(self, size: int | None = -1) -> str:  # type: ignore[override]
            del size
            os.kill(os.getpid(), signal.SIGINT)
            return "\n"

    monkeypatch.setattr("sys.stdin", Pressed())
    with StopSignals() as signals:
        person = at_the_terminal(signals, None, yes=False)
        assert person is not None
        with pytest.raises(Aborted, match="stopped by SIGINT"):
            person(MOVE)
