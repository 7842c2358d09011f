"""The seal of a journal: each line ends with the SHA-256 of all bytes before it in the file.

So no line can be changed, added, moved or taken away without every later one saying so, and the last line vouches for
the whole. What a copy makes of line ends changes nothing: they count as LF. Who can write the file can also write
all seals anew: what shows that is a signature (`vcfbench.records.signing`).
"""

from hashlib import sha256

_BEFORE = b',"seal":"'
_AFTER = b'"}\n'
_TAIL = len(_BEFORE) + 64 + len(_AFTER)


class Sealer:
    """Seals line after line; one not yet kept (:meth:`keep`) can be sealed again after a write that failed."""

    __slots__ = ("_kept", "_next", "_next_seal", "seal")

    def __init__(self, before: bytes = b"") -> None:
        self._kept = self._next = sha256(before)
        self.seal: str | None = None
        self._next_seal = ""

    def sealed(self, line: bytes) -> bytes:
        """Return a line, one JSON object without its end, with its seal and its end."""
        self._next = self._kept.copy()
        self._next.update(line[:-1])
        self._next_seal = self._next.hexdigest()
        tail = b"%s%s%s" % (_BEFORE, self._next_seal.encode(), _AFTER)
        self._next.update(tail)
        return line[:-1] + tail

    def keep(self) -> None:
        """Go on from the line that was sealed last: it is on the disk."""
        self._kept, self.seal = self._next, self._next_seal

    def holds(self, line: bytes) -> bool:
        """Return True if the seal of the next line, LF as its end, follows from the lines before."""
        whole = len(line) > _TAIL and self.sealed(line[:-_TAIL] + b"}") == line
        self.keep()
        return whole


def holds_whole(data: bytes) -> bool:
    """Return True if the last line of a journal vouches for all of it; its line ends must be LF."""
    seal = sha256(memoryview(data)[:-_TAIL]).hexdigest().encode()
    return data[-_TAIL:] == b"%s%s%s" % (_BEFORE, seal, _AFTER)
