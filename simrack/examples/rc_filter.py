"""An RC low-pass of 1 kohm and 100 nF between the generator and the meters."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from simrack.wired import Circuit

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class RcFilter(Circuit):
    """A low-pass of first order."""

    def __init__(self, resistance_ohm: float, capacitance_f: float) -> None:
        self.name = f"RC low-pass of {resistance_ohm:g} ohm and {capacitance_f:g} F"
        self.output_ohm = resistance_ohm
        self.time_constant_s = resistance_ohm * capacitance_f
        self.memory_s = 20 * self.time_constant_s

    def transfer(self, frequency_hz: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return output over input at each frequency."""
        return 1.0 / (1.0 + 2j * math.pi * frequency_hz * self.time_constant_s)


CIRCUIT = RcFilter(1e3, 100e-9)
