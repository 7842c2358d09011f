"""What the ACUTROL3000 says of itself: who it is, what it has, what an error number means."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.rate_tables.acl.arguments import integer, one
from simrack.rate_tables.acl.refusal import WORDS

if TYPE_CHECKING:
    from simrack.rate_tables.acl.arguments import Arguments, Query


def system_queries() -> dict[str, Query]:
    """Return what can be asked about the controller itself."""
    return {
        "*IDN": lambda _: "Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a",
        "Query:System": lambda _: "1,1",
        "Query:Error": _error_words,
        "Query:TotalVariables": lambda _: "0",
    }


def _error_words(arguments: Arguments) -> str:
    return WORDS.get(integer(one(arguments), 0, 65535), "UNKNOWN ERROR")
