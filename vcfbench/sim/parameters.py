"""Every physical parameter of the simulated bench, with its unit, meaning and source.

Annotations are values here, not texts: the ranges in them are held against every value.

Nothing here is a result: scale factors, biases and non-linearities are what comes out of the model. The defaults are a
perfect bench before its gains are computed. The two sets that are shipped, `ideal` and `paper`, are made in
:mod:`vcfbench.sim.gyro.design`.
"""

import math
from collections.abc import Iterator
from typing import Annotated, Any, NamedTuple

from msgspec import Struct

from vcfbench.errors import ConfigError

PAPER = "Wang et al. 2018"
CHOSEN = "chosen"
UNVERIFIED = "chosen, unverified"
OFF = "off: it would move the paper's figures"


class _Range(Struct, frozen=True):
    """Range of values that the model can compute with; `least` belongs to it, `above` does not."""

    least: float = -math.inf
    most: float = math.inf
    above: float = -math.inf

    def holds(self, value: float) -> bool:
        return self.least <= value <= self.most and value > self.above

    def __str__(self) -> str:
        bounds = {"above": self.above, "at least": self.least, "at most": self.most}
        return "a number " + " and ".join(f"{word} {bound:g}" for word, bound in bounds.items() if math.isfinite(bound))


ANY = _Range()
POSITIVE = _Range(above=0.0)
NOT_NEGATIVE = _Range(least=0.0)
A_FREQUENCY = _Range(above=0.0, most=1e6)
OSCILLATES = _Range(above=0.5)
A_TEMPERATURE = _Range(least=-100.0, most=200.0)


class Quantity(NamedTuple):
    """Description of a parameter: its unit, one line of meaning, its bounds, the source of its value."""

    unit: str
    meaning: str
    allowed: _Range = ANY
    source: str = CHOSEN


class _Group(Struct, frozen=True):
    """Parameters that know their ranges: each is annotated with its :class:`Quantity`."""

    def __post_init__(self) -> None:
        """Refuse a value with which the model has no meaning; bench files show these words beside the key.

        Raises:
            ValueError: what was expected instead.
        """
        for name, quantity in self.quantities().items():
            value = getattr(self, name)
            for number in value if isinstance(value, tuple) else (value,):
                if not quantity.allowed.holds(number):
                    raise ValueError(str(quantity.allowed))

    @classmethod
    def quantities(cls) -> dict[str, Quantity]:
        """Return the description of each parameter, by its name."""
        return {name: Quantity(*annotated.__metadata__) for name, annotated in cls.__annotations__.items()}


class DriveMode(_Group, frozen=True):
    """The anti-phase drive mode x."""

    frequency_hz: Annotated[
        float, "Hz", "resonance at the reference temperature", A_FREQUENCY, f"{PAPER}, section 4.2"
    ] = 3488.9
    quality: Annotated[
        float, "1", "quality factor at the reference temperature", OSCILLATES, f"{PAPER}, section 4.2"
    ] = 1395.0
    mass_kg: Annotated[float, "kg", "equivalent mass of the drive mode", POSITIVE] = 5e-7
    frequency_coefficient_per_k: Annotated[
        float, "1/K", "relative change of the resonance", _Range(least=-1e-3, most=1e-3), "silicon, about -30 ppm/K"
    ] = 0.0
    quality_coefficient_per_k: Annotated[float, "1/K", "relative change of the quality factor"] = 0.0


class SenseMode(_Group, frozen=True, kw_only=True):
    """One sense mode; forces on each mass count positive in the direction of that mass's Coriolis force."""

    frequency_hz: Annotated[
        float, "Hz", "resonance at the reference temperature", A_FREQUENCY, f"{PAPER}: 4.2 (y2), FEM (y1)"
    ]
    quality: Annotated[
        float, "1", "quality factor at the reference temperature", OSCILLATES, f"{PAPER}, 4.2 (y2); chosen equal (y1)"
    ] = 1224.0
    left_participation: Annotated[float, "1", "share of a force on the left mass that drives the mode"]
    right_participation: Annotated[float, "1", "share of a force on the right mass that drives the mode"]
    pick_off_v_per_m: Annotated[float, "V/m", "displacement to voltage: K_inyv (y1), K_anyv (y2)"] = 2e5
    quadrature_rad_s: Annotated[float, "rad/s", "quadrature force as the rate that would excite as much"] = 0.0
    frequency_coefficient_per_k: Annotated[
        float, "1/K", "relative change of the resonance", _Range(least=-1e-3, most=1e-3)
    ] = 0.0
    quality_coefficient_per_k: Annotated[float, "1/K", "relative change of the quality factor"] = 0.0


class DriveLoop(_Group, frozen=True):
    """AGC and PLL around the drive mode."""

    amplitude_m: Annotated[float, "m", "drive amplitude A_x that the AGC holds", POSITIVE] = 5e-6
    pick_off_v_per_m: Annotated[float, "V/m", "drive pick-off, node `drive`"] = 2e5
    agc_proportional: Annotated[
        float, "1", "AGC proportional gain, on amplitudes relative to the set one", NOT_NEGATIVE
    ] = 7.0
    agc_integral_per_s: Annotated[float, "1/s", "AGC integral gain", NOT_NEGATIVE] = 200.0
    force_limit_n_per_v: Annotated[float, "N/V", "largest drive force per volt of the weaker rail", POSITIVE] = 3.5e-7
    pll_proportional_per_s: Annotated[
        float, "1/s", "PLL proportional gain, rad/s of frequency per rad of phase", NOT_NEGATIVE
    ] = 90.0
    pll_integral_per_s2: Annotated[float, "1/s^2", "PLL integral gain", NOT_NEGATIVE] = 4000.0
    pll_free_running_offset_hz: Annotated[float, "Hz", "VCO frequency before lock, minus the resonance"] = 5.0
    amplitude_supply_coefficient_per_v: Annotated[
        float, "1/V", "relative change of A_x with the weaker rail", _Range(least=-0.05, most=0.05)
    ] = 0.0


class SensePath(_Group, frozen=True):
    """From the pick-off to the low-pass filter."""

    preamplifier_gain: Annotated[float, "1", "K_pre"] = 10.0
    amplifier_gain: Annotated[float, "1", "K_amp"] = 10.0
    reference_amplitude_v: Annotated[
        float, "V", "V_dac at the nominal A_x; it follows the drive pick-off", POSITIVE
    ] = 2.0
    demodulator_phase_rad: Annotated[float, "rad", "phase of the multiplier's reference against the drive force"] = (
        math.pi
    )
    multiplier_per_v: Annotated[
        float, "1/V", "scale of the demodulator's multiplier", ANY, "chosen, as analogue multipliers"
    ] = 0.1
    low_pass_hz: Annotated[float, "Hz", "cut-off of the low-pass filter", POSITIVE, f"{PAPER}, section 3"] = 100.0
    low_pass_order: Annotated[
        int, "1", "order of the Butterworth low-pass filter", _Range(least=1, most=10), "chosen; the paper gives none"
    ] = 4
    carrier_feedthrough: Annotated[float, "V/V", "part of the carrier that is in V_s without any motion", ANY, OFF] = (
        0.0
    )
    v_vc_feedthrough: Annotated[
        float, "V/V", "part of the modulated V_Vc, on its carrier, that is in V_s without any motion", ANY, OFF
    ] = 0.0
    dead_band_deg_s: Annotated[
        float,
        "deg/s",
        "half width of the dead band: of rate and virtual rate together, what is within moves nothing",
        NOT_NEGATIVE,
        "off; that there is one, and its form, is an assumption",
    ] = 0.0
    g_sensitivity_deg_s_g: Annotated[
        tuple[float, ...],
        "(deg/s)/g",
        "bias by what supports the case, 9.80665 m/s^2 up its x, y, z axis",
        ANY,
        "off; data sheets of MEMS gyroscopes have 0.01 to 0.1 (unverified)",
    ] = (0.0, 0.0, 0.0)


class VirtualPath(_Group, frozen=True):
    """From the V_Vc input to the force on the feedback combs."""

    pull_down_ohm: Annotated[float, "ohm", "resistor from the V_Vc input to ground", POSITIVE] = 1e6
    carrier_phase_rad: Annotated[float, "rad", "phase of the carrier against the drive force"] = math.pi
    left_comb_n_per_v2: Annotated[float, "N/V^2", "K_FBY of the left feedback combs"] = 1e-8
    right_comb_n_per_v2: Annotated[float, "N/V^2", "K_FBY of the right feedback combs (paper's Error 1)"] = 1e-8
    mass_kg: Annotated[float, "kg", "sense mass m_y, taken equal to the Coriolis mass", POSITIVE] = 5e-7
    offset_v: Annotated[float, "V", "modulator's leakage while its switch is closed, as V_Vc"] = 0.0
    second_order_per_v: Annotated[float, "1/V", "modulator's curvature, on V_Vc^2"] = 0.0
    third_order_per_v2: Annotated[float, "1/V^2", "modulator's curvature, on V_Vc^3"] = 0.0


class OutputStage(_Group, frozen=True):
    """The output amplifier: y = sum of orders[k] u^k, u = gain times the filtered signal."""

    gain: Annotated[float, "1", "linear gain"] = 1.0
    offset_v: Annotated[float, "V", "offset at the output"] = 0.0
    second_order_per_v: Annotated[float, "1/V", "curvature, on u^2"] = 0.0
    third_order_per_v2: Annotated[float, "1/V^2", "curvature, on u^3"] = 0.0
    headroom_v: Annotated[float, "V", "how far from each rail the output saturates", NOT_NEGATIVE] = 1.5

    @property
    def orders(self) -> tuple[float, ...]:
        """Coefficients of u^0, u^1, ...: the one list of orders."""
        return self.offset_v, 1.0, self.second_order_per_v, self.third_order_per_v2


class Supply(_Group, frozen=True):
    """Behaviour of the PCB on its rails."""

    nominal_v: Annotated[float, "V", "magnitude of both rails", POSITIVE, f"{PAPER}, section 4.1"] = 10.0
    start_v: Annotated[float, "V", "weaker rail at which the drive loop starts", POSITIVE] = 8.0
    brown_out_v: Annotated[float, "V", "weaker rail below which the drive loop stops", POSITIVE] = 7.0
    dead_v: Annotated[float, "V", "weaker rail below which every node is 0 V", NOT_NEGATIVE] = 4.0
    rails: Annotated[float, "1", "2, or 1: of one supply, whose other side is ground", _Range(least=1.0, most=2.0)] = (
        2.0
    )
    input_ohm: Annotated[float, "ohm", "of each rail's input without power", POSITIVE, UNVERIFIED] = 1000.0
    quiescent_a: Annotated[float, "A", "current of each rail while running", NOT_NEGATIVE] = 0.028
    start_up_a: Annotated[float, "A", "additional current while the drive starts", NOT_NEGATIVE] = 0.012
    ripple_feedthrough: Annotated[
        float, "V/V", "part of each rail's ripple that comes through to the output", NOT_NEGATIVE
    ] = 0.0

    @property
    def single(self) -> bool:
        """True of one supply."""
        return self.rails < 2.0


class NoiseSources(_Group, frozen=True):
    """Random disturbances, as rates at the input."""

    angle_random_walk_deg_sqrt_s: Annotated[
        float, "deg/sqrt(s)", "white force noise, both quadratures", NOT_NEGATIVE, f"{PAPER}: 0.21 deg/sqrt(h)"
    ] = 0.0
    bias_instability_deg_s: Annotated[
        float,
        "deg/s",
        "coefficient B of the flicker noise",
        NOT_NEGATIVE,
        f"{PAPER}: Allan minimum 3.7 deg/h, divided by 0.664",
    ] = 0.0
    flicker_shortest_s: Annotated[float, "s", "shortest correlation time of the flicker noise", POSITIVE] = 0.125
    flicker_processes: Annotated[
        int, "1", "number of Ornstein-Uhlenbeck processes, each four times slower", _Range(least=0, most=30)
    ] = 9
    switch_on_bias_deg_s: Annotated[
        float, "deg/s", "standard deviation of the bias from switch-on to switch-on", NOT_NEGATIVE, "off"
    ] = 0.0
    switch_on_scale_factor: Annotated[
        float, "1", "the same of the scale factor, relative", _Range(least=0.0, most=0.01), "off; of V_Vc alike"
    ] = 0.0


class PickUp(_Group, frozen=True):
    """Pick-up of the mains by the leads; its phases come from the seed."""

    mains_hz: Annotated[float, "Hz", "nominal line frequency", _Range(least=1.0), "the bench file: site.mains_hz"] = (
        50.0
    )
    mains_deviation_hz: Annotated[
        float,
        "Hz",
        "standard deviation of the line frequency from bench to bench, constant within a run",
        _Range(least=0.0, most=2.0),
        "off; a grid keeps within some 0.05 Hz (unverified)",
    ] = 0.0
    meter_leads_v: Annotated[float, "V rms", "in the loop of the multimeter's leads", NOT_NEGATIVE, UNVERIFIED] = 0.0
    v_vc_lead_v: Annotated[float, "V rms", "in the lead from generator to V_Vc", NOT_NEGATIVE, UNVERIFIED] = 0.0


class Thermal(_Group, frozen=True):
    """Temperature of the gyro and its effect on the bias."""

    ambient_c: Annotated[float, "degC", "air on the bench", A_TEMPERATURE, f"{PAPER}, Table 1"] = 20.0
    reference_c: Annotated[
        float, "degC", "temperature at which the parameters hold", A_TEMPERATURE, f"{PAPER}, Table 1"
    ] = 20.0
    self_heating_k: Annotated[float, "K", "rise when powered for long", _Range(least=0.0, most=100.0)] = 0.0
    time_constant_s: Annotated[float, "s", "of the warm-up", POSITIVE] = 300.0
    bias_coefficient_deg_s_k: Annotated[float, "(deg/s)/K", "bias, hence the warm-up exponential"] = 0.0
    refresh_k: Annotated[
        float, "K", "frequencies and quality factors are refreshed each time this much is passed", _Range(least=1e-4)
    ] = 0.02


class TableMechanics(_Group, frozen=True):
    """True motion of the rate table under its servo."""

    loop_hz: Annotated[float, "Hz", "natural frequency of the rate loop", POSITIVE, "BD125 data sheet: 25 Hz"] = 25.0
    loop_damping: Annotated[
        float, "1", "damping of the rate loop", _Range(least=0.1, most=0.99), "suggested, unverified"
    ] = 0.8
    rate_error: Annotated[
        float, "1", "relative error of the mean rate", _Range(least=-0.5, most=0.5), "BD125 class: 10 ppm, unverified"
    ] = 0.0
    misalignment_deg: Annotated[
        float,
        "deg",
        "from the table's axis to the gyroscope's, which sees the cosine of its rates; no horizontal part",
        _Range(least=0.0, most=45.0),
        "off; 1 degree takes 152 ppm",
    ] = 0.0
    ripple_arcsec: Annotated[tuple[float, ...], "arcsec", "amplitude of the angle error of each harmonic"] = ()
    ripple_harmonic: Annotated[tuple[int, ...], "1/turn", "periods of each harmonic in a turn", _Range(least=1)] = ()
    ripple_phase_rad: Annotated[tuple[float, ...], "rad", "phase of each harmonic at angle zero"] = ()
    flutter_per_sqrt_hz: Annotated[
        float,
        "1/sqrt(Hz)",
        "flutter of the true rate, a share of it, at the frequency of the loop",
        NOT_NEGATIVE,
        "chosen, unverified; 5e-4 would be the BD125's 10 ppm over a turn at 100 deg/s",
    ] = 0.0
    friction_deg_s2: Annotated[float, "deg/s^2", "dry friction with the servo open", POSITIVE] = 5.0
    friction_time_s: Annotated[float, "s", "time constant of viscous friction with the servo open", POSITIVE] = 20.0


class Site(_Group, frozen=True):
    """Place of the bench."""

    latitude_deg: Annotated[
        float,
        "deg",
        "geographic latitude; the table axis is vertical",
        _Range(least=-90.0, most=90.0),
        "Taiyuan, unverified",
    ] = 0.0
    up: Annotated[
        tuple[float, ...],
        "1",
        "where up is, by the axes of the case; z is the input axis, and points east while it is level",
        _Range(least=-1.0, most=1.0),
    ] = (0.0, 0.0, 1.0)
    input_axis: Annotated[
        tuple[float, ...],
        "1",
        "direction of the input axis by those of the case, where a device has three of them; of length 1",
        _Range(least=-1.0, most=1.0),
    ] = (0.0, 0.0, 1.0)


class SourceResistance(_Group, frozen=True):
    """Resistance behind the outputs of the PCB; the generator brings its own to v_vc, the rails count as 0 ohm."""

    output_ohm: Annotated[float, "ohm", "node `output`: a resistor after the amplifier", NOT_NEGATIVE] = 100.0
    drive_ohm: Annotated[float, "ohm", "node `drive`: a resistor after the buffer", NOT_NEGATIVE] = 100.0
    carrier_ohm: Annotated[float, "ohm", "node `carrier`: a resistor after the buffer", NOT_NEGATIVE] = 100.0
    sense_ohm: Annotated[float, "ohm", "node `sense`: a resistor after the buffer", NOT_NEGATIVE] = 100.0


class ParameterRow(Struct, frozen=True):
    """One line of ``vcfbench sim show``: a number of the simulation by its dotted path."""

    path: str
    value: Any
    unit: str
    meaning: str
    source: str


class Contradiction(ConfigError):
    """Parameters that contradict each other."""

    def __init__(self, expected: str, came: object) -> None:
        super().__init__(f"simulation.override: expected {expected}, got {came}")
        self.expected = expected
        self.came = came


class BenchParameters(Struct, frozen=True, kw_only=True):
    """The whole simulated bench, but for the errors of its instruments."""

    drive_mode: DriveMode = DriveMode()
    sense_in_phase: SenseMode
    sense_anti_phase: SenseMode
    drive_loop: DriveLoop = DriveLoop()
    sense_path: SensePath = SensePath()
    virtual_path: VirtualPath = VirtualPath()
    output_stage: OutputStage = OutputStage()
    supply: Supply = Supply()
    noise: NoiseSources = NoiseSources()
    thermal: Thermal = Thermal()
    table: TableMechanics = TableMechanics()
    site: Site = Site()
    source: SourceResistance = SourceResistance()
    pick_up: PickUp = PickUp()

    def __post_init__(self) -> None:
        """Refuse values that contradict each other, whatever group they are in.

        Raises:
            Contradiction: which ones, and what was expected.
        """
        for expected, came, holds in self._agreements():
            if not holds:
                raise Contradiction(expected, came)

    def _agreements(self) -> Iterator[tuple[str, object, bool]]:
        table, supply, thermal = self.table, self.supply, self.thermal
        sizes = [len(table.ripple_arcsec), len(table.ripple_harmonic), len(table.ripple_phase_rad)]
        yield "table.ripple_arcsec, ripple_harmonic and ripple_phase_rad of one length", sizes, len({*sizes}) == 1
        rising = [supply.dead_v, supply.brown_out_v, supply.start_v]
        yield "supply.dead_v at most brown_out_v, and that at most start_v", rising, rising == sorted(rising)
        up, per_g = self.site.up, self.sense_path.g_sensitivity_deg_s_g
        yield "three figures of length 1 in site.up", up, len(up) == 3 and math.isclose(math.hypot(*up), 1.0)
        yield "three figures in sense_path.g_sensitivity_deg_s_g", per_g, len(per_g) == 3
        path, lead_v = self.sense_path, self.pick_up.v_vc_lead_v
        beside = [path.dead_band_deg_s, path.v_vc_feedthrough, lead_v]
        rule = "with a sense_path.dead_band_deg_s no sense_path.v_vc_feedthrough and no pick_up.v_vc_lead_v"
        yield rule, beside, not path.dead_band_deg_s or not (path.v_vc_feedthrough or lead_v)
        for name in ("drive_mode", "sense_in_phase", "sense_anti_phase"):
            mode = getattr(self, name)
            rises = (thermal.ambient_c - thermal.reference_c, thermal.self_heating_k)
            worst = min(mode.quality * (1 + mode.quality_coefficient_per_k * rise) for rise in (rises[0], sum(rises)))
            yield f"{name}.quality above 0.5 at every temperature from ambient_c up", worst, worst > 0.5

    def rows(self) -> list[ParameterRow]:
        """Return every parameter with its dotted path, unit, meaning and source."""
        return [
            ParameterRow(
                f"{group}.{name}", getattr(getattr(self, group), name), quantity.unit, quantity.meaning, quantity.source
            )
            for group in self.__struct_fields__
            for name, quantity in getattr(self, group).quantities().items()
        ]
