"""The three outputs of the simulated E3631A by design.

Source: Keysight E3631A User's Guide E3631-90002, ed. 10, 2018 (p. 91, 186-187).
"""

from __future__ import annotations

from msgspec import Struct
from msgspec.structs import replace

from simrack.scpi import Limits


class OutputKind(Struct, frozen=True):
    """Design of an output.

    Args:
        name: as in the commands. number: as in INSTrument:NSELect. sign: of its voltage.
        volts, amps: ranges (p. 91). volt_step, amp_step: programming and read-back resolution (p. 186).
        rise_s, fall_s: settling at no load and at full load, s (p. 187).
        rated_a: its rated current (p. 186).
        capacitance_f: the capacitor across it (p. 187).
    """

    name: str
    number: int
    sign: int
    volts: Limits
    amps: Limits
    volt_step: float
    amp_step: float
    rise_s: tuple[float, float]
    fall_s: tuple[float, float]
    rated_a: float
    capacitance_f: float


P6V = OutputKind(
    name="P6V",
    number=1,
    sign=1,
    volts=Limits(0.0, 6.18, 0.0),
    amps=Limits(0.0, 5.15, 5.0),
    volt_step=0.5e-3,
    amp_step=0.5e-3,
    rise_s=(0.010, 0.011),
    fall_s=(0.2, 0.013),
    rated_a=5.0,
    capacitance_f=1000e-6,
)
P25V = OutputKind(
    name="P25V",
    number=2,
    sign=1,
    volts=Limits(0.0, 25.75, 0.0),
    amps=Limits(0.0, 1.03, 1.0),
    volt_step=1.5e-3,
    amp_step=0.1e-3,
    rise_s=(0.02, 0.05),
    fall_s=(0.4, 0.045),
    rated_a=1.0,
    capacitance_f=470e-6,
)
N25V = replace(P25V, name="N25V", number=3, sign=-1, volts=Limits(0.0, -25.75, 0.0))
KINDS = (P6V, P25V, N25V)
