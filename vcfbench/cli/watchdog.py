"""``python -m vcfbench.cli.watchdog``: the process that makes a bench safe when the program that had it died or hangs.

Its standard input is a pipe from that program, `vcfbench.bench.watchdog`: first the bench, then steps and signs of
life, one JSON object a line. While all is well it exchanges nothing with any instrument and loads nothing that could.
"""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import threading
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Final

from vcfbench.bench.processes import KILL, end, mark_of
from vcfbench.clock import WallClock, sleep

if TYPE_CHECKING:
    from vcfbench.bench.description import BenchDescription
    from vcfbench.bench.lock import InUse
    from vcfbench.bench.safing import MadeSafe
    from vcfbench.record.signing import SigningKey

_TURN_S: Final = 0.1
_SILENT_TURNS: Final = 20
"""Turns without a sign of life after which the program hangs: what stops the whole computer stops turns too."""
_FREED_S: Final = 5.0
"""How long the locks of a program that has just died may take to be free."""
_OTHERS_S: Final = 30.0
"""For how long it waits for another process that has the bench: longer than a `safe` takes, which may die too."""


def main() -> int:
    """Watch until the program has left its bench; else make that safe. Returns 0 when all is safe, 5 when it is not."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # meant for the program, which leaves its bench and then this process
        if (number := getattr(signal, name, None)) is not None:
            signal.signal(number, signal.SIG_IGN)
    said: SimpleQueue[dict[str, Any] | None] = SimpleQueue()
    threading.Thread(target=_listen, args=(said,), daemon=True).start()
    charge = said.get()
    if charge is None:
        return 0
    os.write(1, b"ready\n")
    watch = _Watch(said, charge["owner"], charge["mark"])
    why = watch.until_it_ends()
    if why is None:
        return 0
    return _make_safe(charge, watch, why)


def _listen(said: SimpleQueue[dict[str, Any] | None]) -> None:
    for line in sys.stdin.buffer:
        with suppress(ValueError):  # the last line of a program that was killed may be torn
            said.put(json.loads(line))
    said.put(None)


class _Watch:
    """What is known of the program that is watched."""

    def __init__(self, said: SimpleQueue[dict[str, Any] | None], owner: int, mark: str | None) -> None:
        self._said = said
        self._owner, self._mark = owner, mark
        self.step = ""
        self.left = False
        self.journal: Path | None = None

    def until_it_ends(self) -> str | None:
        """Return None when the program has left its bench in order, else what has become of it."""
        clock, silent, ends_s = WallClock(), 0, math.inf
        while silent < _SILENT_TURNS and clock.now() <= ends_s:
            try:
                heard = self._said.get(timeout=_TURN_S)
            except Empty:
                silent += 1
                if silent == _SILENT_TURNS // 2:
                    import vcfbench.bench.safing  # noqa: F401, PLC0415  # it may be needed in a second
                continue
            if heard is None:
                return "the program died"
            if "left" in heard:
                self.left = True
                return None if heard["left"] else "the program has not made its bench safe"
            if "overdue" in heard:
                return self._ended(f"a call never returned ({heard['overdue']})")
            silent = 0
            self.journal = Path(heard["journal"]) if "journal" in heard else self.journal
            if "step" in heard:
                self.step, longest_s = heard["step"], heard["longest_s"]
                ends_s = math.inf if longest_s is None else clock.now() + longest_s
        silence = f"the program gave no sign of life for {_SILENT_TURNS * _TURN_S:g} s"
        return self._ended(silence if silent else "its step took longer than it may")

    def _ended(self, why: str) -> str:
        """End the program that hangs: nobody else can have its wires before."""
        with suppress(OSError):
            end(self._owner, self._mark, KILL)
        return f"{why} and was ended"


def _make_safe(charge: dict[str, Any], watch: _Watch, why: str) -> int:
    from vcfbench.cli.ending import say  # noqa: PLC0415  # nothing of it is needed while all is well
    from vcfbench.errors import NotSafe  # noqa: PLC0415

    where = f" in {watch.step}" if watch.step else ""
    try:
        done = _safe(charge, left=watch.left)
    except Exception as error:  # noqa: BLE001  # whatever went wrong, somebody must go and look
        _write(charge, watch, {"why": f"{why}{where}", "safe": None, "error": f"{type(error).__name__}: {error}"})
        say(f"vcfbench watchdog: {why}{where}; NOT SAFE: {error}", alarm=True)
        _notify(charge, watch, f"{why}{where}; NOT SAFE: {error}", 5)
        return 5
    failure = done.failure()
    left_to = ", ".join(sorted({str(each.owner or "another process") for each in done.left_to.values()}))
    instruments = [{"instrument": each.role, "found": each.found, "safe": each.safe, "detail": each.detail}
                   for each in done.instruments]  # fmt: skip
    unsafe = isinstance(failure, NotSafe)
    taken = {"left_to": left_to} if left_to else {}
    _write(charge, watch, {"why": f"{why}{where}", "safe": not unsafe, "instruments": instruments, **taken})
    came = f"what {left_to} has taken over was left to it" if left_to else "the bench was made safe"
    words = f"{why}{where}; {failure if unsafe else came}"
    say(f"vcfbench watchdog: {words}", alarm=unsafe)
    code = NotSafe.exit_code if unsafe else None
    _notify(charge, watch, words, code)
    return code or 0


def _notify(charge: dict[str, Any], watch: _Watch, error: str, code: int | None) -> None:
    """Tell the program that the bench file names of a run that can tell nothing itself any more."""
    if charge["bench"].get("notify") is None:
        return
    from vcfbench.bench.description import Notify  # noqa: PLC0415  # as above
    from vcfbench.runs.notified import notify  # noqa: PLC0415
    from vcfbench.typed import typed  # noqa: PLC0415

    directory = None if watch.journal is None else watch.journal.parent
    outcome = {
        "outcome": "NOT SAFE" if code else "failed",
        "exit_code": code,
        "error": error,
        "run": None if directory is None else directory.name,
        "directory": None if directory is None else str(directory),
        "bench": charge["bench"].get("name"),
    }
    with suppress(Exception):  # the bench is what counts
        notify(typed(charge["bench"]["notify"], Notify), outcome)


def _safe(charge: dict[str, Any], *, left: bool) -> MadeSafe:
    """Make the bench safe as soon as the locks of the program that had it are free; `left`: it lives on without it."""
    from vcfbench.bench.description import BenchDescription  # noqa: PLC0415  # as above
    from vcfbench.bench.lock import InUse  # noqa: PLC0415
    from vcfbench.bench.safing import safe_bench  # noqa: PLC0415
    from vcfbench.errors import ConnectFailed  # noqa: PLC0415
    from vcfbench.typed import typed  # noqa: PLC0415

    description = typed(charge["bench"], BenchDescription)
    clock = WallClock()

    def owner_lives() -> bool:
        return bool(mark_of(charge["owner"]) == charge["mark"])

    while not left and owner_lives() and clock.now() < _FREED_S:
        sleep(clock, _TURN_S)  # as it dies it gives its locks back one by one, and then its wires
    while True:
        try:
            return safe_bench(description)
        except InUse as error:
            others = error.owner is not None and error.owner.pid != charge["owner"]
            if clock.now() > (_OTHERS_S if others else _FREED_S):
                return _without_locks(description, error, left=others, dead=not owner_lives())
        except ConnectFailed:
            if clock.now() > _FREED_S:
                raise
        sleep(clock, _TURN_S)


def _without_locks(description: BenchDescription, error: InUse, *, left: bool, dead: bool) -> MadeSafe:
    """Leave the bench to a run that has taken it over; what a dead one leaves behind with its locks drives nothing."""
    from vcfbench.bench.safing import MadeSafe, safe_bench  # noqa: PLC0415  # as above

    if left:
        return MadeSafe((), (), left_to={"all": error})
    if dead:
        return safe_bench(description, force=True)
    raise error


def _write(charge: dict[str, Any], watch: _Watch, values: dict[str, Any]) -> None:
    """Add a line to the journal of the run, in place of one that was torn, and sign it where the run would have."""
    if watch.journal is None or watch.left:  # who lives on closes its own record
        return
    from vcfbench.record.journal import append_line  # noqa: PLC0415  # as above

    key = None
    with suppress(Exception):  # a line that is not signed says more than none
        key = _key_of(charge)
    with suppress(Exception):  # the bench is what counts
        append_line(watch.journal, {"type": "watchdog", **values}, key)


def _key_of(charge: dict[str, Any]) -> SigningKey | None:
    from vcfbench.record.signing import named_key  # noqa: PLC0415  # as above

    return named_key((charge["bench"].get("laboratory") or {}).get("signing_key"))


if __name__ == "__main__":
    code = main()
    sys.stderr.flush()
    os._exit(code)  # the thread that listens has standard input, which an orderly end would want
