"""What generators and supplies put on the inputs of the PCB, in closed form."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Drive", "Ripple", "Sine"]


@dataclass(frozen=True, slots=True)
class Sine:
    """amplitude_v sin(2 pi frequency_hz t + phase_rad), t in bench time."""

    amplitude_v: float
    frequency_hz: float
    phase_rad: float


@dataclass(frozen=True, slots=True)
class Drive:
    """What a generator puts out, open circuit.

    dc_v + amplitude_v sin(2 pi frequency_hz t + phase_rad), t in bench time, and `overtones`: harmonics of a waveform
    that is no sine, sidebands of a modulated one.
    """

    dc_v: float
    amplitude_v: float = 0.0
    frequency_hz: float = 0.0
    phase_rad: float = 0.0
    source_ohm: float = 50.0
    overtones: tuple[Sine, ...] = ()


@dataclass(frozen=True, slots=True)
class Ripple:
    """What a supply leaves on its output of the rectified mains: a sine, its phase at bench time 0."""

    rms_v: float
    frequency_hz: float
    phase_rad: float
