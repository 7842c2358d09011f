"""What the host has asked the ACUTROL3000's axis for, used or not."""

from __future__ import annotations

from msgspec import Struct


class Demand(Struct):
    """The demanded states; selecting a mode uses those that it knows, stale or not."""

    rate_deg_s: float = 0.0
    position_deg: float = 0.0
    acceleration_deg_s2: float = 0.0
    delta_deg: float = 0.0
    oscillator: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Magnitude of the regulated state, frequency in Hz, phase in degrees."""
