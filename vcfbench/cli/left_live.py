"""A bench that its program has left live is made safe by the watchdog process (`vcfbench.cli.watchdog`)."""

from __future__ import annotations

import json
import signal
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from vcfbench.clock import WallClock, sleep
from vcfbench.safety.processes import KILL, end, mark_of

if TYPE_CHECKING:
    from vcfbench.bench.make_safe import MadeSafe
    from vcfbench.safety.lock import InUse
    from vcfbench.station.description import BenchDescription

_LOOK_S: Final = 0.1
_FREED_S: Final = 5.0
"""Longest time until the locks of a program that has just died are free, s."""
_OTHERS_S: Final = 30.0
"""For how long it waits for another process that has the bench: longer than a `safe` takes, which may die too."""


Said = Mapping[bytes, bytes]
"""The last words of each kind that the program said to `vcfbench.cli.watchdog`."""


def end_owner(said: Said) -> None:
    """End the program that hangs."""
    charge = json.loads(said[b"bench"])
    with suppress(OSError):
        end(charge["owner"], charge["mark"], KILL)


def make_safe(said: Said, why: str) -> int:
    """Make safe the bench that was `said`, because of `why`; return 0 when all is safe, 5 when it is not."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # meant for the program; until now they were blocked
        if (number := getattr(signal, name, None)) is not None:
            signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
    charge = json.loads(said[b"bench"])
    where = f" in {json.loads(said[b'step'])}" if b"step" in said else ""
    try:
        done = _safe(charge, left=b"left" in said)
    except Exception as error:  # noqa: BLE001  # whatever went wrong, somebody must go and look
        _write(charge, said, {"why": f"{why}{where}", "safe": None, "error": f"{type(error).__name__}: {error}"})
        _say(f"{why}{where}; NOT SAFE: {error}", alarm=True)
        _notify(charge, said, f"{why}{where}; NOT SAFE: {error}", 5)
        return 5
    from vcfbench.errors import NotSafe  # noqa: PLC0415  # as in `_safe`

    failure = done.failure()
    left_to = ", ".join(sorted({str(each.owner or "another process") for each in done.left_to.values()}))
    instruments = [{"instrument": each.role, "found": each.found, "safe": each.safe, "detail": each.detail}
                   for each in done.instruments]  # fmt: skip
    unsafe = isinstance(failure, NotSafe)
    taken = {"left_to": left_to} if left_to else {}
    _write(charge, said, {"why": f"{why}{where}", "safe": not unsafe, "instruments": instruments, **taken})
    came = f"what {left_to} has taken over was left to it" if left_to else "the bench was made safe"
    words = f"{why}{where}; {failure if unsafe else came}"
    _say(words, alarm=unsafe)
    code = NotSafe.exit_code if unsafe else None
    _notify(charge, said, words, code)
    return code or 0


def _say(words: str, *, alarm: bool) -> None:
    from vcfbench.cli.ending import say  # noqa: PLC0415  # it takes as long to load as an instrument to be told

    say(f"vcfbench watchdog: {words}", alarm=alarm)


def _notify(charge: dict[str, Any], said: Said, error: str, code: int | None) -> None:
    """Tell the program that the bench file names of a run that can tell nothing itself any more."""
    if charge["bench"].get("notify") is None:
        return
    from vcfbench.runs.notified import notify  # noqa: PLC0415
    from vcfbench.station.description import Notify  # noqa: PLC0415  # few stations have one
    from vcfbench.typed import typed  # noqa: PLC0415

    directory = Path(json.loads(said[b"journal"])).parent if b"journal" in said else None
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
    from vcfbench.bench.make_safe import safe_bench  # noqa: PLC0415
    from vcfbench.errors import ConnectFailed  # noqa: PLC0415
    from vcfbench.safety.lock import InUse  # noqa: PLC0415
    from vcfbench.station.description import BenchDescription  # noqa: PLC0415  # one that is missing is told of
    from vcfbench.typed import typed  # noqa: PLC0415

    description = typed(charge["bench"], BenchDescription)
    clock = WallClock()

    def owner_lives() -> bool:
        return bool(mark_of(charge["owner"]) == charge["mark"])

    while not left and owner_lives() and clock.now() < _FREED_S:
        sleep(clock, _LOOK_S)  # as it dies it gives its locks back one by one, and then its wires
    while True:
        try:
            done = safe_bench(description)
            owner = charge["owner"]
            own = [each for each in done.left_to.values() if each.owner is not None and each.owner.pid == owner]
            if left or not own:
                return done
            error, taken, alone = own[0], False, len(own) == len(done.left_to)
            longest_s = _OTHERS_S  # what was free is safe
        except InUse as refused:
            error, alone = refused, True
            taken = refused.owner is not None and refused.owner.pid != charge["owner"]
            longest_s = _OTHERS_S if taken else _FREED_S
        except ConnectFailed:
            if clock.now() > _FREED_S:
                raise
            error = None
        if error is not None and clock.now() > longest_s:
            return _without_locks(description, error, left=taken, dead=alone and not owner_lives())
        sleep(clock, _LOOK_S)


def _without_locks(description: BenchDescription, error: InUse, *, left: bool, dead: bool) -> MadeSafe:
    """Leave the bench to a run that has taken it over; the locks left by a dead one drive nothing."""
    from vcfbench.bench.make_safe import MadeSafe, safe_bench  # noqa: PLC0415  # as above

    if left:
        return MadeSafe((), (), left_to={"all": error})
    if dead:
        return safe_bench(description, force=True)
    raise error


def _write(charge: dict[str, Any], said: Said, values: dict[str, Any]) -> None:
    """Add a line to the journal of the run, in place of one that was torn, and sign it where the run would have."""
    if b"journal" not in said or b"left" in said:  # who lives on closes its own record
        return
    from vcfbench.records.journal import append_line  # noqa: PLC0415  # as above

    key = None
    with suppress(Exception):  # a line that is not signed says more than none
        from vcfbench.records.signing import named_key  # noqa: PLC0415  # as above

        key = named_key((charge["bench"].get("laboratory") or {}).get("signing_key"))
    with suppress(Exception):  # the bench is what counts
        append_line(Path(json.loads(said[b"journal"])), {"type": "watchdog", **values}, key)
