"""The watchdog process: it watches a program that has a bench, and makes that safe when the program died or hangs.

Its standard input is a pipe from that program, `vcfbench.safety.watchdog`: first its number and what it drives, then
the bench, then steps and signs of life, a line each. While all is well it exchanges nothing with any instrument and
loads nothing that could. A run waits for it to be ready: queues, signals, JSON and paths of Python's library would take
as long as all the rest of it.
"""

from __future__ import annotations

import _thread
import os
import sys

from vcfbench.cli.last_words import not_safe, say, write

TYPE_CHECKING = False  # as in vcfbench/__init__.py
if TYPE_CHECKING:
    from types import ModuleType

TURN_S = 0.1
_LOADING = _thread.allocate_lock()
SILENT_TURNS = 20
"""Turns without a sign of life after which the program hangs, where it says no other time: a stop of the whole computer
stops turns too."""
NOT_SAFE = 5
"""Exit code of a bench that is not safe."""


def main() -> None:
    """Watch until the program has left its bench; else make that safe. Ends with 0 when all is safe, 5 when not."""
    watch = Watch()
    why: str | None = "the watchdog failed"
    code = 5
    try:
        why = watch.until_it_ends()
        code = 0 if why is None or b"bench" not in watch.said else loaded().make_safe(watch.said, why)
        if code == NOT_SAFE:
            code = loaded().try_again(watch.said, why)
    except BaseException as error:  # noqa: BLE001  # a package that was moved away, files or memory that are used up
        say(f"{why}; {not_safe(watch.said, error)}")
    finally:
        os._exit(code)  # the thread that listens has standard input, which an orderly end would want


def loaded() -> ModuleType:
    """Return the module that makes a bench safe; it is loaded only when needed.

    Without numpy, which PyVISA wants for arrays: it takes as long as PyVISA.
    """
    with _LOADING:
        if "vcfbench.cli.left_live" not in sys.modules:
            import site  # noqa: PLC0415

            site.main()  # it was started without: an editable installation may need it
            sys.modules["numpy"] = None  # type: ignore[assignment]  # an import raises ImportError
            try:
                import vcfbench.bench.abandoned  # noqa: PLC0415
                import vcfbench.drivers.visa_wire  # noqa: F401, PLC0415
            except Exception:  # noqa: BLE001, S110  # whoever needs it will say so
                pass
            del sys.modules["numpy"]
        import vcfbench.cli.left_live as acting  # noqa: PLC0415

        return acting


def _prepare() -> None:
    """Load the code that switches the bench off before it is needed; a failure shows when it is used."""
    try:  # noqa: SIM105  # as in `write`
        loaded()
    except Exception:  # noqa: BLE001, S110
        pass


class Watch:
    """The watched program; `said` has its last words of each kind, as they came."""

    def __init__(self) -> None:
        self.said: dict[bytes, bytes] = {}
        self._turn, self._silent_turns = 0, SILENT_TURNS
        self._prepared = False
        self._heard_turn = self._last_turn = float("inf")
        self._over = _thread.allocate_lock()
        self._over.acquire()
        _thread.start_new_thread(self._listen, ())

    def until_it_ends(self) -> str | None:
        """Return None when the program has left its bench in order, else its fate in words."""
        while not self._over.acquire(timeout=TURN_S):
            self._turn += 1
            silent = self._turn - self._heard_turn
            if (silent == self._silent_turns // 2 or b"late" in self.said) and not self._prepared:
                self._prepared = True
                try:  # noqa: SIM105  # as in `write`
                    _thread.start_new_thread(_prepare, ())  # it may be needed in a second
                except RuntimeError:  # no thread is left: then it is loaded when it is needed
                    pass
            if silent >= self._silent_turns:
                return self._ended(f"the program did not respond for {self._silent_turns * TURN_S:g} s")
            if self._turn > self._last_turn:
                return self._ended("its step took longer than allowed")
        if b"overdue" in self.said:
            return self._ended(f"a call never returned ({self.said[b'overdue'].decode()})")
        if b"left" in self.said:
            return None if self.said[b"left"] == b"safe" else "the program did not make its bench safe"
        return "the program died"

    def _listen(self) -> None:
        try:
            for line in sys.stdin.buffer:
                if line.endswith(b"\n"):  # the last one of a program that was killed may be torn
                    kind, _, words = line[:-1].partition(b" ")
                    self._hear(kind, words)
                    if kind in {b"left", b"overdue"}:
                        break
        finally:
            self._over.release()

    def _hear(self, kind: bytes, words: bytes) -> None:
        self._heard_turn = float("inf") if kind == b"idle" else self._turn  # nothing drives: it may take its time
        if b"bench" in self.said and kind in {b"beat", b"idle", b"late"}:
            write(1, b"heard\n")
        if kind == b"silent":
            self._silent_turns = round(float(words) / TURN_S)
        if kind == b"step":
            longest_s, _, words = words.partition(b" ")
            self._last_turn = self._turn + float(longest_s) / TURN_S
        self.said[kind] = words
        if kind == b"bench":
            try:  # noqa: SIM105  # as in `write`
                os.set_blocking(1, False)  # a program that is stopped hears no answers
            except (OSError, AttributeError):  # Windows' pipes have it since Python 3.12
                pass
            write(1, b"ready\n")

    def _ended(self, why: str) -> str:
        """End the program that hangs: nobody else can have its wires before."""
        try:
            loaded().end_owner(self.said)
        except Exception:  # noqa: BLE001  # who makes safe will say so; the program would hold the wires for ever
            if (owner := int(self.said[b"owner"].partition(b" ")[0])) == os.getppid():  # it is still the one
                os.kill(owner, 9)
        return f"{why} and was ended"
