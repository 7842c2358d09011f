"""The last read-back of an instrument and its time, for messages when it no longer answers."""

from vcfbench.clock import Clock
from vcfbench.interfaces import UnprovedCommand


class LastRead:
    """The last read-back of one instrument."""

    __slots__ = ("_at_s", "_clock", "_what")

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._what: str | None = None
        self._at_s = 0.0

    def note(self, what: str) -> None:
        """Remember a read-back, in words."""
        self._what, self._at_s = what, self._clock.now()

    def unproved(self, words: str, *, sent: bool) -> UnprovedCommand:
        """Return the command that nothing proved, beside the last read-back."""
        if self._what is None:
            return UnprovedCommand(words, sent)
        try:
            age_s = self._clock.now() - self._at_s
        except Exception:  # noqa: BLE001 - a bench's clock may be gone with the bench; what was read is still known
            return UnprovedCommand(words, sent, self._what)
        return UnprovedCommand(words, sent, self._what, age_s)
