"""Short and long forms: `VOLTage`, `ISUMmary<1-3>`."""

from __future__ import annotations

import re

from msgspec import Struct

_PATTERN = re.compile(r"(\*?[A-Z][A-Z0-9_]*)([a-z0-9_]*)(?:<(\d+)-(\d+)>)?")


class Mnemonic(Struct, frozen=True):
    """A keyword: exactly its short or exactly its long form, case apart; `suffixes` is the range of its number."""

    short: str
    long: str
    suffixes: tuple[int, int] | None = None

    @classmethod
    def parse(cls, text: str) -> Mnemonic:
        """Read the manual's spelling: the short form in capitals, `<1-4>` for a numeric suffix; ValueError if not."""
        match = _PATTERN.fullmatch(text)
        if match is None:
            raise ValueError(f"{text!r} is not a mnemonic")
        suffixes = None if match[3] is None else (int(match[3]), int(match[4]))
        return cls(match[1], (match[1] + match[2]).upper(), suffixes)

    @property
    def spellings(self) -> tuple[str, ...]:
        """The accepted spellings, upper case, without suffix."""
        return (self.short,) if self.short == self.long else (self.short, self.long)

    def match(self, word: str) -> int | None:
        """Return the suffix of `word` (1 when it has none), None when it is another word or out of range."""
        if self.suffixes is None:
            return 1 if word in self.spellings else None
        stem = word.rstrip("0123456789")
        number = int(word[len(stem) :] or "1")
        in_range = self.suffixes[0] <= number <= self.suffixes[1]
        return number if stem in self.spellings and in_range else None
