"""A bench that its program has left live is made safe by the watchdog process (`vcfbench.cli.watchdog`)."""

import json
import signal
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from vcfbench.cli import last_words
from vcfbench.errors import NotSafe
from vcfbench.safety.processes import KILL, end

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
        from vcfbench.bench.abandoned import safe_abandoned  # noqa: PLC0415  # what is missing of it is told of

        done = safe_abandoned(charge, left=b"left" in said)
    except Exception as error:  # noqa: BLE001  # whatever went wrong, somebody must go and look
        words = f"{why}{where}; {last_words.not_safe(said, error)}"
        _say(words, alarm=True)
        _write(charge, said, {"why": f"{why}{where}", "safe": None, "error": f"{type(error).__name__}: {error}"})
        _notify(charge, said, words, 5)
        return 5
    failure = done.failure()
    left_to = ", ".join(sorted({str(each.owner or "another process") for each in done.left_to.values()}))
    instruments = [{"instrument": each.role, "found": each.found, "safe": each.safe, "detail": each.detail}
                   for each in done.instruments]  # fmt: skip
    unsafe = isinstance(failure, NotSafe)
    taken = {"left_to": left_to} if left_to else {}
    came = f"what {left_to} has taken over was left to it" if left_to else "the bench was made safe"
    words = f"{why}{where}; {failure if unsafe else came}"
    _say(words, alarm=unsafe)
    _write(charge, said, {"why": f"{why}{where}", "safe": not unsafe, "instruments": instruments, **taken})
    code = NotSafe.exit_code if unsafe else None
    _notify(charge, said, words, code)
    return code or 0


def _say(words: str, *, alarm: bool) -> None:
    try:
        from vcfbench.cli.ending import say  # noqa: PLC0415  # it takes as long to load as an instrument to be told

        say(f"vcfbench watchdog: {words}", alarm=alarm)
    except Exception:  # noqa: BLE001  # what it needs is gone: the words must reach somebody
        last_words.say(words)


def _notify(charge: dict[str, Any], said: Said, error: str, code: int | None) -> None:
    """Tell the program that the bench file names, if it names one."""
    if charge["bench"].get("notify") is not None:
        with suppress(Exception):  # the bench is what counts
            from vcfbench.runs.notified import notify_in_place_of  # noqa: PLC0415  # few stations have one

            directory = Path(json.loads(said[b"journal"])).parent if b"journal" in said else None
            notify_in_place_of(directory, charge["bench"], error, code)


def _write(charge: dict[str, Any], said: Said, values: dict[str, Any]) -> None:
    """Add a line to the journal of the run, in place of one that was torn, and sign it where the run would have."""
    if b"journal" not in said or b"left" in said:  # who lives on closes its own record
        return
    key = None
    with suppress(Exception):  # a line that is not signed says more than none
        from vcfbench.records.signing import named_key  # noqa: PLC0415  # as above

        key = named_key((charge["bench"].get("laboratory") or {}).get("signing_key"))
    with suppress(Exception):  # the bench is what counts
        from vcfbench.records.journal import append_line  # noqa: PLC0415  # few runs end so

        append_line(Path(json.loads(said[b"journal"])), {"type": "watchdog", **values}, key)
