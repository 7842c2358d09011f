"""Data sheets by model: the accuracies of the simulated instruments, and the further limits of budgets."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from msgspec import Struct
from simrack.specifications import (
    AGILENT_33220A,
    HP_34401A,
    KEITHLEY_2000,
    KEITHLEY_DMM6500,
    KEYSIGHT_33500B,
    KEYSIGHT_34461A,
    KEYSIGHT_34465A,
    Accuracy,
    LevelSpecification,
    VoltmeterSpecification,
)

__all__ = [
    "AGILENT_33220A",
    "HP_34401A",
    "KEITHLEY_2000",
    "KEITHLEY_DMM6500",
    "KEYSIGHT_33500B",
    "KEYSIGHT_34461A",
    "KEYSIGHT_34465A",
    "KEYSIGHT_E3631A",
    "KEYSIGHT_E36312A",
    "ROOM_C",
    "TEMPERATURE_COEFFICIENTS",
    "WORST_OF_CLASS",
    "Accuracy",
    "Assumed",
    "LevelSpecification",
    "SupplySpecification",
    "VoltmeterSpecification",
    "accuracy_at",
]


def accuracy_at(
    sheet: VoltmeterSpecification, range_v: float, age_days: float, outside_k: float = 0.0
) -> tuple[Accuracy, float | None]:
    """Return the largest error on a range so long after a calibration, and how many sigmas it is, whatever is known.

    Beyond the ages of the data sheet its last limits are taken to grow on with time. On a range that it has nothing of,
    they are those of a 34401A, the worst of these meters, and any error within is as likely. `outside_k` is how far
    the room may be outside of 18 to 28 degC.
    """
    of = sheet if range_v in sheet.accuracy else HP_34401A
    promised, oldest = of.known_accuracy(range_v, age_days), max(of.accuracy[range_v])
    if promised is None:
        last, grown = of.accuracy[range_v][oldest], age_days / oldest
        promised = Accuracy(last.reading * grown, last.range * grown)
    by = TEMPERATURE_COEFFICIENTS.get(range_v, _USUAL_COEFFICIENT)
    warmer = Accuracy(promised.reading + outside_k * by.reading, promised.range + outside_k * by.range)
    return warmer, of.limit_sigmas if of is sheet else None


_USUAL_COEFFICIENT: Final = Accuracy(5e-6, 1e-6)
TEMPERATURE_COEFFICIENTS: Final = MappingProxyType({0.1: Accuracy(5e-6, 5e-6)})
"""Temperature coefficient for each kelvin outside of 18 to 28 degC, by range: 34401A, p. 216; assumed of the others."""
ROOM_C: Final = (18.0, 28.0)
"""Temperatures at which data sheets of voltmeters hold, degC."""


class SupplySpecification(Struct, frozen=True):
    """Limits of a supply's read-backs, by output: a part of the reading, plus volts or amperes.

    `limit_sigmas` is how many standard deviations of its specimens a limit is; None: any error within is as likely.
    """

    model: str
    voltage: Mapping[str, tuple[float, float]]
    current: Mapping[str, tuple[float, float]]
    source: str
    limit_sigmas: float | None = None


KEYSIGHT_E3631A: Final = SupplySpecification(
    model="E3631A",
    voltage=MappingProxyType({"P6V": (1e-3, 5e-3), "P25V": (5e-4, 10e-3), "N25V": (5e-4, 10e-3)}),
    current=MappingProxyType({"P6V": (2e-3, 10e-3), "P25V": (1.5e-3, 4e-3), "N25V": (1.5e-3, 4e-3)}),
    source="User's Guide E3631-90002 p. 186, 12 months at 25 +- 5 degC",
)

KEYSIGHT_E36312A: Final = SupplySpecification(
    model="E36312A",
    voltage=MappingProxyType({"P6V": (3e-4, 3e-3), "P25V": (3e-4, 5e-3), "N25V": (3e-4, 5e-3)}),
    current=MappingProxyType({"P6V": (1e-3, 5e-3), "P25V": (1e-3, 2e-3), "N25V": (1e-3, 2e-3)}),
    source="from memory of the data sheet 5992-2124EN and rounded up, unverified",
)


class Assumed(Struct, frozen=True):
    """Assumed value without a statement: the worst of a class, and the name of that class."""

    value: float
    unit: str
    source: str


_A_DEGREE: Final = "0.8 us at 3.5 kHz: a capacitor of a filter off by 3 %; no source"
WORST_OF_CLASS: Final = MappingProxyType(
    {
        "table_rate_error": Assumed(1e-3, "", "a stepping stage, or a direct drive over 1 degree"),
        "bias_instability_deg_h": Assumed(
            100.0, "deg/h", "rate-grade MEMS, whose bias wanders by 10 to 1000 deg/h; unverified"
        ),
        "scale_factor_ppm_k": Assumed(
            500.0, "ppm/K", "370 without compensation (Cao 2019, PMC6523767), 320 of consumer parts, rounded up"
        ),
        "bias_deg_h_k": Assumed(600.0, "deg/h/K", "consumer parts: 20 deg/s from -40 to 85 degC (MPU-6050)"),
        "warm_up_k": Assumed(5.0, "K", "a board of a watt in still air; unverified"),
        "warm_up_time_s": Assumed(900.0, "s", "a board in a closed housing; unverified"),
        "k_vc_drift_ppm_per_year": Assumed(
            500.0,
            "ppm per year",
            "stability of the scale factor of a tactical MEMS gyroscope, STIM210; no source for K_Vc",
        ),
        "k_vc_on_the_way_ppm": Assumed(
            500.0, "ppm", "as much as in a year: shock, storage, remounting; no source for K_Vc"
        ),
        "misalignment_deg": Assumed(1.0, "deg", "package on board and board on table; unverified"),
        "output_ohm": Assumed(1e4, "ohm", "a resistor of a filter in front of the connector; no source"),
        "temperature_k": Assumed(5.0, "K", "a room of 18 to 28 degC, either side of its middle"),
        "carrier_phase_deg": Assumed(1.0, "deg", _A_DEGREE),
        "demodulator_phase_deg": Assumed(1.0, "deg", _A_DEGREE),
        "bias_deg_s_demodulator_deg": Assumed(
            2.0, "deg/s per degree", "quadrature of 100 deg/s, rounded up; unverified"
        ),
    }
)
"""Values that a bench file need not state, by their key of ``[uncertainty]``."""
