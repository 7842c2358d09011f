"""Every physical parameter of the simulated bench, with its unit, meaning and source.

Nothing here is a result: scale factors, biases and non-linearities are what comes out of the model. Two sets are
shipped. :meth:`BenchParameters.ideal` has every imperfection off, noise too; :meth:`BenchParameters.paper` is a
realistic specimen whose imperfections were *chosen* so that the calibration of Wang et al. (2018) comes out.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, is_dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = [
    "BenchParameters",
    "DriveLoop",
    "DriveMode",
    "NoiseSources",
    "OutputStage",
    "ParameterRow",
    "SenseMode",
    "SensePath",
    "Site",
    "Supply",
    "TableMechanics",
    "Thermal",
    "VirtualPath",
]

PAPER = "Wang et al. 2018"
CHOSEN = "chosen"


def quantity(unit: str, meaning: str, source: str) -> Any:
    """Declare a parameter: its unit, one line of meaning, and where its value comes from."""
    return field(metadata={"unit": unit, "meaning": meaning, "source": source})


@dataclass(frozen=True, slots=True)
class DriveMode:
    """The anti-phase drive mode x."""

    frequency_hz: float = quantity("Hz", "resonance at the reference temperature", f"{PAPER}, section 4.2")
    quality: float = quantity("1", "quality factor at the reference temperature", f"{PAPER}, section 4.2")
    mass_kg: float = quantity("kg", "equivalent mass of the drive mode", CHOSEN)
    frequency_coefficient_per_k: float = quantity("1/K", "relative change of the resonance", "silicon, about -30 ppm/K")
    quality_coefficient_per_k: float = quantity("1/K", "relative change of the quality factor", CHOSEN)


@dataclass(frozen=True, slots=True)
class SenseMode:
    """One sense mode; forces on each mass count positive in the direction of that mass's Coriolis force."""

    frequency_hz: float = quantity("Hz", "resonance at the reference temperature", f"{PAPER}: 4.2 (y2), FEM (y1)")
    quality: float = quantity(
        "1", "quality factor at the reference temperature", f"{PAPER}, 4.2 (y2); chosen equal (y1)"
    )
    left_participation: float = quantity("1", "share of a force on the left mass that drives the mode", CHOSEN)
    right_participation: float = quantity("1", "share of a force on the right mass that drives the mode", CHOSEN)
    pick_off_v_per_m: float = quantity("V/m", "displacement to voltage: K_inyv (y1), K_anyv (y2)", CHOSEN)
    quadrature_rad_s: float = quantity("rad/s", "quadrature force as the rate that would excite as much", CHOSEN)
    frequency_coefficient_per_k: float = quantity("1/K", "relative change of the resonance", CHOSEN)
    quality_coefficient_per_k: float = quantity("1/K", "relative change of the quality factor", CHOSEN)


@dataclass(frozen=True, slots=True)
class DriveLoop:
    """AGC and PLL around the drive mode."""

    amplitude_m: float = quantity("m", "drive amplitude A_x that the AGC holds", CHOSEN)
    pick_off_v_per_m: float = quantity("V/m", "drive pick-off, node `drive`", CHOSEN)
    agc_proportional: float = quantity("1", "AGC proportional gain, on amplitudes relative to the set one", CHOSEN)
    agc_integral_per_s: float = quantity("1/s", "AGC integral gain", CHOSEN)
    force_limit_n_per_v: float = quantity("N/V", "largest drive force per volt of the weaker rail", CHOSEN)
    pll_proportional_per_s: float = quantity(
        "1/s", "PLL proportional gain, rad/s of frequency per rad of phase", CHOSEN
    )
    pll_integral_per_s2: float = quantity("1/s^2", "PLL integral gain", CHOSEN)
    pll_free_running_offset_hz: float = quantity("Hz", "VCO frequency before lock, minus the resonance", CHOSEN)
    amplitude_supply_coefficient_per_v: float = quantity("1/V", "relative change of A_x with the weaker rail", CHOSEN)


@dataclass(frozen=True, slots=True)
class SensePath:
    """From the pick-off to the low-pass filter."""

    preamplifier_gain: float = quantity("1", "K_pre", CHOSEN)
    amplifier_gain: float = quantity("1", "K_amp", CHOSEN)
    reference_amplitude_v: float = quantity("V", "V_dac at the nominal A_x; it follows the drive pick-off", CHOSEN)
    demodulator_phase_rad: float = quantity(
        "rad", "phase of the multiplier's reference against the drive force", CHOSEN
    )
    multiplier_per_v: float = quantity(
        "1/V", "scale of the demodulator's multiplier", "chosen, as analogue multipliers"
    )
    low_pass_hz: float = quantity("Hz", "cut-off of the low-pass filter", f"{PAPER}, section 3")
    low_pass_order: int = quantity("1", "order of the Butterworth low-pass filter", "chosen; the paper gives none")


@dataclass(frozen=True, slots=True)
class VirtualPath:
    """From the V_Vc input to the force on the feedback combs."""

    pull_down_ohm: float = quantity("ohm", "resistor from the V_Vc input to ground", CHOSEN)
    carrier_phase_rad: float = quantity("rad", "phase of the carrier against the drive force", CHOSEN)
    left_comb_n_per_v2: float = quantity("N/V^2", "K_FBY of the left feedback combs", CHOSEN)
    right_comb_n_per_v2: float = quantity("N/V^2", "K_FBY of the right feedback combs (paper's Error 1)", CHOSEN)
    mass_kg: float = quantity("kg", "sense mass m_y, taken equal to the Coriolis mass", CHOSEN)
    offset_v: float = quantity("V", "modulator's leakage while its switch is closed, as V_Vc", CHOSEN)
    second_order_per_v: float = quantity("1/V", "modulator's curvature, on V_Vc^2", CHOSEN)
    third_order_per_v2: float = quantity("1/V^2", "modulator's curvature, on V_Vc^3", CHOSEN)


@dataclass(frozen=True, slots=True)
class OutputStage:
    """The output amplifier: y = offset + u + second u^2 + third u^3, u = gain times the filtered signal."""

    gain: float = quantity("1", "linear gain", CHOSEN)
    offset_v: float = quantity("V", "offset at the output", CHOSEN)
    second_order_per_v: float = quantity("1/V", "curvature, on u^2", CHOSEN)
    third_order_per_v2: float = quantity("1/V^2", "curvature, on u^3", CHOSEN)
    headroom_v: float = quantity("V", "how far from each rail the output saturates", CHOSEN)


@dataclass(frozen=True, slots=True)
class Supply:
    """What the PCB does with its rails."""

    nominal_v: float = quantity("V", "magnitude of both rails", f"{PAPER}, section 4.1")
    start_v: float = quantity("V", "weaker rail at which the drive loop starts", CHOSEN)
    brown_out_v: float = quantity("V", "weaker rail below which the drive loop stops", CHOSEN)
    dead_v: float = quantity("V", "weaker rail below which every node is 0 V", CHOSEN)
    quiescent_a: float = quantity("A", "current of each rail while running", CHOSEN)
    start_up_a: float = quantity("A", "additional current while the drive starts", CHOSEN)


@dataclass(frozen=True, slots=True)
class NoiseSources:
    """Random disturbances, as rates at the input."""

    angle_random_walk_deg_sqrt_s: float = quantity(
        "deg/sqrt(s)", "white force noise, both quadratures", f"{PAPER}: 0.21 deg/sqrt(h)"
    )
    bias_instability_deg_s: float = quantity(
        "deg/s", "coefficient B of the flicker noise", f"{PAPER}: Allan minimum 3.7 deg/h, divided by 0.664"
    )
    flicker_shortest_s: float = quantity("s", "shortest correlation time of the flicker noise", CHOSEN)
    flicker_processes: int = quantity("1", "number of Ornstein-Uhlenbeck processes, each four times slower", CHOSEN)


@dataclass(frozen=True, slots=True)
class Thermal:
    """Temperature of the gyro and what the bias does with it."""

    ambient_c: float = quantity("degC", "air on the bench", f"{PAPER}, Table 1")
    reference_c: float = quantity("degC", "temperature at which the parameters hold", f"{PAPER}, Table 1")
    self_heating_k: float = quantity("K", "rise when powered for long", CHOSEN)
    time_constant_s: float = quantity("s", "of the warm-up", CHOSEN)
    bias_coefficient_deg_s_k: float = quantity("(deg/s)/K", "bias, hence the warm-up exponential", CHOSEN)
    refresh_k: float = quantity(
        "K", "frequencies and quality factors are refreshed each time this much is passed", CHOSEN
    )


@dataclass(frozen=True, slots=True)
class TableMechanics:
    """True motion of the rate table under its servo."""

    loop_hz: float = quantity("Hz", "natural frequency of the rate loop", "BD125 data sheet: 25 Hz")
    loop_damping: float = quantity("1", "damping of the rate loop", "suggested, unverified")
    rate_error: float = quantity("1", "relative error of the mean rate", "BD125 class: 10 ppm, unverified")
    ripple_arcsec: tuple[float, ...] = quantity("arcsec", "amplitude of the angle error of each harmonic", CHOSEN)
    ripple_harmonic: tuple[int, ...] = quantity("1/turn", "periods of each harmonic in a turn", CHOSEN)
    ripple_phase_rad: tuple[float, ...] = quantity("rad", "phase of each harmonic at angle zero", CHOSEN)
    friction_deg_s2: float = quantity("deg/s^2", "dry friction with the servo open", CHOSEN)
    friction_time_s: float = quantity("s", "time constant of viscous friction with the servo open", CHOSEN)


@dataclass(frozen=True, slots=True)
class Site:
    """Where the bench stands."""

    latitude_deg: float = quantity("deg", "geographic latitude; the table axis is vertical", "Taiyuan, unverified")


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """One line of ``vcfbench sim show``."""

    path: str
    value: float | int | tuple[float, ...] | tuple[int, ...]
    unit: str
    meaning: str
    source: str


@dataclass(frozen=True, slots=True)
class BenchParameters:
    """The whole simulated bench, but for the errors of its instruments."""

    drive_mode: DriveMode
    sense_in_phase: SenseMode
    sense_anti_phase: SenseMode
    drive_loop: DriveLoop
    sense_path: SensePath
    virtual_path: VirtualPath
    output_stage: OutputStage
    supply: Supply
    noise: NoiseSources
    thermal: Thermal
    table: TableMechanics
    site: Site

    @classmethod
    def ideal(cls) -> BenchParameters:
        """Return the bench with every imperfection off, noise too."""
        from vcfbench.sim.gyro.design import ideal_bench  # noqa: PLC0415  (the design needs these classes)

        return ideal_bench()

    @classmethod
    def paper(cls) -> BenchParameters:
        """Return the realistic bench; see :mod:`vcfbench.sim.gyro.design` for what was chosen and how."""
        from vcfbench.sim.gyro.design import paper_bench  # noqa: PLC0415  (the design needs these classes)

        return paper_bench()

    def rows(self) -> list[ParameterRow]:
        """Return every parameter with its dotted path, unit, meaning and source."""
        return list(_rows("", self))


def _rows(prefix: str, group: Any) -> Iterator[ParameterRow]:
    for each in fields(group):
        value = getattr(group, each.name)
        path = f"{prefix}{each.name}"
        if is_dataclass(value):
            yield from _rows(f"{path}.", value)
        else:
            yield ParameterRow(path, value, each.metadata["unit"], each.metadata["meaning"], each.metadata["source"])
