"""Values in the entries of a device: each with its uncertainty, curves of K_Vc, conditions, characteristics."""

import math
from typing import Annotated, Self

from msgspec import Meta, Struct, structs

Uncertainty = Annotated[float, Meta(ge=0.0)]
Text = Annotated[str, Meta(min_length=1, max_length=1000)]
Freedom = Annotated[float, Meta(gt=0.0)]


class Frozen(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An entry, or a part of one: frozen, strict."""


class Share(Frozen, frozen=True, kw_only=True):
    """Contribution of one source to a standard uncertainty, in the unit of the value."""

    source: Text  # Name of the source, in words
    u: float  # Contribution; the sign is that of its effect, the same in all entries
    of: Text | None = None  # Instrument or certificate that gives other entries the same; it cancels
    dof: Freedom | None = None  # Its degrees of freedom; None is as many as one likes


class Measured(Frozen, frozen=True, kw_only=True):
    """A value with its standard uncertainty; the unit is in the name of the field that holds it."""

    value: float
    u: Uncertainty  # Standard uncertainty (k = 1), in the unit of the value
    dof: Freedom | None = None  # Effective degrees of freedom of `u`; None is as many as one likes
    shares: tuple[Share, ...] = ()  # Contributions to `u`, where they are known: their squares add up to its square
    missing: tuple[Text, ...] = ()  # Contributions that `u` lacks, because nobody told them

    def signed(self, sign: float) -> Self:
        """Return this size with the sign of `number`."""
        return structs.replace(self, value=math.copysign(self.value, sign))


class Conditions(Frozen, frozen=True, kw_only=True):
    """Conditions of a measurement."""

    bench: Text  # Name of the station
    run: Text  # Name of the record
    simulated: bool  # True on a simulated bench
    positive_rail_v: float | None = None  # Positive rail of the PCB, V; None where the device feeds itself
    negative_rail_v: float | None = None  # Negative rail, V
    temperature_c: float | None = None  # Of the device or of the air at it, degC; None where nobody measured it
    instruments: dict[str, str] = {}  # Instruments used: ``*IDN?`` by role

    @property
    def rails_v(self) -> tuple[float, float] | None:
        """Positive and negative rail, V; None where the device feeds itself."""
        positive, negative = self.positive_rail_v, self.negative_rail_v
        return None if positive is None or negative is None else (positive, negative)


class Characteristics(Frozen, frozen=True, kw_only=True):
    """Properties of a device on which K_Vc depends; None if not measured.

    The names of what `vcfbench.analysis.k_vc_model` knows are those that it has there.
    """

    temperature_c: Measured | None = None  # Temperature at which the rest was measured, degC
    drive_hz: Measured | None = None  # Drive frequency, locked
    split_hz: Measured | None = None  # Drive less anti-phase sense frequency, below 0 where the mode is above the drive
    split_size_hz: Measured | None = None  # Its size, where only that was seen: a beat has no sign
    q_anti_phase: Measured | None = None  # Quality factor of that mode
    in_phase_split_hz: Measured | None = None  # Drive less in-phase sense frequency
    q_in_phase: Measured | None = None  # Quality factor of that mode
    in_phase_share: Measured | None = None  # Part of that mode in the static response to V_Vc, by stiffness, signed
    carrier_phase_deg: Measured | None = None  # Against the drive's velocity, apart from half turns; 0 is ideal
    demodulator_phase_deg: Measured | None = None  # Phase of the demodulator's reference against the same
    comb_mismatch: Measured | None = None  # In-phase over anti-phase force, over that of a rate, less 1; 0: equal combs
    v_vc_feedthrough: Measured | None = None  # Of V_Vc into the sense signal without motion, over the modes' response
    drive_amplitude_v: Measured | None = None  # Amplitude of the drive signal, V
    carrier_amplitude_v: Measured | None = None  # Amplitude of the carrier, V
    modulator_second_per_v: Measured | None = None  # Of the modulator, which acts as V + second V^2 + third V^3; 1/V
    modulator_third_per_v2: Measured | None = None  # Its third order, 1/V^2
    output_second_per_deg_s: Measured | None = None  # Of output against rate, as rate + second rate^2 + ...; 1/(deg/s)
    output_third_per_deg_s2: Measured | None = None  # Its third order, 1/(deg/s)^2
    sense_phase_deg: Measured | None = None  # Of the response to V_Vc, less that by carrier, splits and Q
    positive_rail_v: Measured | None = None  # Positive rail as it was read back, V
    negative_rail_v: Measured | None = None  # Negative rail
    drive_ppm_k: Measured | None = None  # Change of the drive frequency with temperature, ppm of it a kelvin
    split_hz_k: Measured | None = None  # Change of the size of `split_hz`, Hz/K
    q_per_k: Measured | None = None  # Change of both quality factors, relative, 1/K
    table_slope_ppm_k: Measured | None = None  # Change of output over rate with temperature, ppm/K, the table turning
    v_vc_slope_ppm_k: Measured | None = None  # Change of output over V_Vc with temperature
    table_slope_ppm_v: Measured | None = None  # Change of output over rate with the size of both rails, ppm a volt
    v_vc_slope_ppm_v: Measured | None = None  # Change of output over V_Vc with the same
    k_vc_ppm_k: Measured | None = None  # Change of K_Vc itself: that of output over V_Vc less that of output over rate
    k_vc_ppm_v: Measured | None = None  # The same with the size of both rails
    least_temperature_c: float | None = None  # Lowest temperature at which any coefficient was measured, degC
    most_temperature_c: float | None = None  # Highest


class Sensitivity(Frozen, frozen=True, kw_only=True):
    """Amount by which K_Vc changes with one quantity, the others held, ppm for one `unit` of it."""

    quantity: Text  # Name of the quantity; `rails_v` is the level of both rails
    unit: str  # Its unit; empty for a ratio
    ppm_per_unit: float  # Change of K_Vc, ppm, for one unit of it
    u_ppm_per_unit: Uncertainty  # Standard uncertainty of that
    assumed: bool  # True where the value is that of the device's class, because nobody measured the quantity itself
