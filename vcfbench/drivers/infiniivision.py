"""Keysight (Agilent) InfiniiVision 3000 X and 4000 X oscilloscopes.

They are spoken to in the DSO7104B's words, which its driver took in good part from their guides. Where they differ is
the length of the measurement record, which is not made use of. ``*IDN?`` writes DSO-X 3024A what is sold as DSOX3024A.
"""

from typing import ClassVar

from vcfbench.drivers.dso7104b import Dso7104B


class InfiniiVisionX(Dso7104B):
    """An oscilloscope of the X series, made by :meth:`of_model`; of a mixed-signal one its analog channels."""

    least_scale_v: ClassVar[float] = 1e-3  # general knowledge of the data sheets, unverified
