"""What every driver says first."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vcfbench.testing import Exchange

NO_ERROR: Exchange = ("SYST:ERR?", '+0,"No error"')


def opening(identity: str) -> list[Exchange]:
    return [("*IDN?", identity), ("*CLS", None)]
