"""How the ACUTROL3000 writes numbers: as decimals, or motion states as scaled integers (Utility:Format)."""

from __future__ import annotations

import struct

from simrack.rate_tables.acl.arguments import Action, Arguments, Query, check_axis, one, word

ANGLE, RATE, ACCELERATION = 180.0, 11250.0, 703125.0
"""Weight of the top bit in BINARY format: deg, deg/s, deg/s2 (TM-8004-C 5.1.2)."""


def decimal(value: float) -> str:
    """Return a number with five decimals."""
    # adding zero turns a rounded -0.0 into 0.0: the controller sends no bare minus
    return f"{round(value, 5) + 0.0:.5f}"


def listed(arguments: Arguments, *values: float) -> str:
    """Return several numbers of the axis that `arguments` name."""
    check_axis(arguments, everything=False)
    return ",".join(decimal(value) for value in values)


def _scaled(value: float, weight: float) -> bytes:
    # least significant byte first (TM-8004-C 2.4)
    return struct.pack("<i", (round(value / weight * 2**31) + 2**31) % 2**32 - 2**31)


class StateFormat:
    """The format in which motion states are told: FLOAT or BINARY."""

    def __init__(self) -> None:
        self._binary = False

    def of_axis(self, arguments: Arguments, *states: tuple[float, float]) -> str:
        """Return the motion states of the axis, each (value, weight of the top bit in BINARY format)."""
        check_axis(arguments, everything=False)
        if not self._binary:
            return ";".join(decimal(value) for value, _ in states)
        block = b"".join(_scaled(value, weight) for value, weight in states)
        length = str(len(block))
        return f"#{len(length)}{length}" + block.decode("latin-1")

    def commands(self) -> dict[str, Action]:
        """Return what can be told about the format."""
        return {"Utility:Format": self._choose}

    def queries(self) -> dict[str, Query]:
        """Return what can be asked about the format."""
        return {"Utility:Format": lambda _: "BINARY" if self._binary else "FLOAT"}

    def _choose(self, arguments: Arguments) -> None:
        self._binary = word(one(arguments), ("Float", "Binary")) == "Binary"
