"""What every driver says first."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vcfbench.testing import Exchange

NO_ERROR: Exchange = ("SYST:ERR?", '+0,"No error"')

OFF_BLIND: Exchange = (b"\nOUTP OFF\n", None)
"""What a supply or a generator is told before anything is asked; the newline ends what is left of a torn command."""


def opening(identity: str) -> list[Exchange]:
    return [("*IDN?", identity), ("*CLS", None)]
