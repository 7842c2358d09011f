"""Why the ACUTROL3000 refuses a command: the error numbers and their words.

The numbers and most of the words are ours: the manual's list of codes is missing.
"""

from __future__ import annotations

PARSING = 1
OUT_OF_RANGE = 2
TOO_LONG = 3
LOCAL = 4
WORDS = {
    0: "NO ERROR",
    PARSING: "COMMAND PARSING ERROR",
    OUT_OF_RANGE: "PARAMETER OUT OF RANGE",
    TOO_LONG: "MESSAGE TOO LONG",
    LOCAL: "REMOTE NOT ACTIVE",
}


class Refusal(Exception):
    """A command that parses but cannot be done; `code` is the error number."""

    def __init__(self, code: int) -> None:
        super().__init__(WORDS[code])
        self.code = code
