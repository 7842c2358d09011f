"""Keysight (Agilent) InfiniiVision 3000 X and 4000 X oscilloscopes.

They are spoken to in the DSO7104B's words, which its driver took in good part from their guides. Where they differ is
the length of the measurement record, which is not made use of. ``*IDN?`` writes DSO-X 3024A what is sold as DSOX3024A.
"""

from __future__ import annotations

from typing import ClassVar

from vcfbench.drivers.dso7104b import Dso7104B

__all__ = ["KeysightDsoX3024A", "KeysightDsoX4104A", "KeysightMsoX3104T"]


class InfiniiVisionX(Dso7104B):
    """An oscilloscope of the X series."""

    least_scale_v: ClassVar[float] = 1e-3  # general knowledge of the data sheets, unverified


class KeysightDsoX3024A(InfiniiVisionX):
    """The DSO-X 3024A."""

    model: ClassVar[str] = "DSOX3024A"


class KeysightMsoX3104T(InfiniiVisionX):
    """The MSO-X 3104T, its analog channels."""

    model: ClassVar[str] = "MSOX3104T"


class KeysightDsoX4104A(InfiniiVisionX):
    """The DSO-X 4104A."""

    model: ClassVar[str] = "DSOX4104A"
