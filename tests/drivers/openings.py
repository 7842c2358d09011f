"""What every driver says first."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from vcfbench.drivers.scpi_instrument import Left
    from vcfbench.testing import Exchange

NO_ERROR: Exchange = ("SYST:ERR?", '+0,"No error"')

OFF_BLIND: Exchange = (b"\nOUTP OFF\n", None)
"""What a supply or a generator is told before anything is asked; the newline ends what is left of a torn command."""


def opening(identity: str) -> list[Exchange]:
    return [("*IDN?", identity), ("*CLS", None)]


def taken_over(left: Sequence[Left], **names: object) -> list[Exchange]:
    """What is said once of what a last user may have left: what is asked is as it should be."""
    rows = [(each.header.format(**names), each.value.format(**names), each.refused) for each in left]
    asked: list[Exchange] = [(f"{header}?", value) for header, value, refused in rows if refused]
    told: list[Exchange] = [(f"{header} {value}".rstrip(), None) for header, value, refused in rows if not refused]
    return [*asked, *told, *([NO_ERROR] if told else [])]
