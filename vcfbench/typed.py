"""Plain values into structs, one thread at a time.

msgspec works a type out when it is first asked for, and leaves it half done where another thread may take it meanwhile:
two runs that begin at once in one process would end the interpreter (msgspec 0.22).
"""

from threading import RLock
from typing import Any, Final, TypeVar, overload

import msgspec
from msgspec.json import Decoder

_T = TypeVar("_T")
_ONE_AT_A_TIME: Final = RLock()
"""Entered again by a conversion while a struct is made."""


@overload
def typed(values: Any, kind: type[_T]) -> _T: ...
@overload
def typed(values: Any, kind: Any) -> Any: ...
def typed(values: Any, kind: Any) -> Any:
    """Return `values` as a `kind`; raises msgspec.ValidationError where they are none."""
    with _ONE_AT_A_TIME:
        return msgspec.convert(values, kind)


def decoder_of(kind: type[_T]) -> Decoder[_T]:
    """Return a decoder of a `kind` from JSON."""
    with _ONE_AT_A_TIME:
        return Decoder(kind)


def unboxed(value: Any) -> Any:
    """Return a number, text or array of numpy's as Python's, which JSON has; anything else as it is."""
    return value.tolist() if hasattr(value, "tolist") else value
