"""Settings of a procedure: frozen numbers, no instruments.

:class:`ProcedureSettings` is what all procedures share; a procedure with keys of its own adds them in a subclass. Each
key has its range in its type, and what it means in the `description` beside it. `station` is what the place gives.
"""

from collections.abc import Iterator
from enum import Enum
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from msgspec import UNSET, Meta, Struct, field, structs

from vcfbench.errors import ConfigError
from vcfbench.models import data_sheet_of
from vcfbench.station import bounds, parts
from vcfbench.station.gaps import GAPS, Gap
from vcfbench.station.invalid_value import InvalidValue, lost_digits
from vcfbench.station.linear_gyro import LinearGyro

if TYPE_CHECKING:
    from vcfbench.drivers.streams.description import Stream
    from vcfbench.records.schema import Point


PAPER_RATES_DEG_S = (
    *(200.0, 100.0, 50.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.0),
    *(-1.0, -2.0, -5.0, -10.0, -20.0, -50.0, -100.0, -200.0),
)
"""The 17 rates of the paper's Table 1 in its order, deg/s."""


V_VC_RANGE_V = 10.0
"""Fixed range of the meter on V_Vc in the calibrations of the paper: a generator's largest level."""


class Match(Enum):
    """Comparison of the two outputs in step 2.

    `ZERO` subtracts from each its own zero output, so that a difference of the zeros does not enter K_Vc. `ABSOLUTE`
    does the paper's words literally; an offset between the two zeros then goes into K_Vc in full.
    """

    ZERO = "zero"
    ABSOLUTE = "absolute"


class Limit(Struct, frozen=True):
    """A result, by its key in the bench file's ``[acceptance]``, passes from `low` to `high`, both included.

    `guarded`: it must keep its expanded uncertainty away from both.
    """

    key: str
    low: float
    high: float
    guarded: bool = False


class PlacedInstrument(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An instrument of the bench file: the model whose data sheet counts, and its number or where it answers.

    `where` is its serial or inventory number in words, else its address, which says nothing outside of `station`.
    `calibrated` is how it was calibrated last, as far as the bench file says so.
    """

    model: str
    where: str
    station: str | None = None
    calibrated: str | None = None

    @property
    def name(self) -> str:
        """Name among the instruments of its bench: ``34401A at GPIB0::22::INSTR``."""
        return f"{self.model} {self.where}"

    @property
    def owner(self) -> str:
        """Specimen and calibration: the error of two results is the same where they share it.

        An address is that of another instrument on another bench; an instrument may be adjusted when it is calibrated.
        """
        station = "" if self.station is None else f" of {self.station}"
        return f"{self.name}{station}" + ("" if self.calibrated is None else f", {self.calibrated}")

    def answering(self, serial_number: str) -> Self:
        """Return the meter with the serial number of its identity, if the bench file has none; 0 is none."""
        if self.station is None or serial_number in {"", "0"}:
            return self
        return structs.replace(self, where=f"no. {serial_number}", station=None)

    def drawn_by(self, seed: int | None) -> Self:
        """Return it as the simulated specimen of a seed, where the bench file has no number of it."""
        return self if self.station is None else structs.replace(self, station=f"{self.station}, seed {seed}")


class MeterKnown(Struct, frozen=True, forbid_unknown_fields=True):
    """Certificate and room of a voltmeter, in addition to its data sheet.

    `outside_k` is how far its room may be outside of where data sheets hold, K; `calibration` are the levels of its
    certificate; `rectangular`: any error within its limits counts as likely, whatever the maker says.
    """

    outside_k: float = 0.0
    calibration: tuple[parts.CalibrationPoint, ...] = ()
    rectangular: bool = False

    def on(self, range_v: float) -> tuple[parts.CalibrationPoint, ...]:
        """Return the levels of the certificate on a range."""
        return tuple(each for each in self.calibration if each.range_v == range_v)


class Sources(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Contributions of instruments and gyroscope to uncertainties, at the settings of the run; None: not known.

    What a bench file leaves open is taken at the worst of its class (`assumed`, by its key, in words) where that is a
    figure; the others are :meth:`gaps`.

    `meter_gain` (relative) and `meter_offset_v` are the limits of the multimeter's errors, of which `meter_sigmas`
    standard deviations lie within (None: any error within is as likely). `generator_gain`, `generator_offset_v` are
    those of V_Vc on each of its ranges, the same at all levels of a range, with a converter of `generator_bits`; its
    ranges end at `generator_ranges_v`, none where nobody knows them, the last at `generator_reach_v`.
    `v_vc_gain`, `v_vc_offset_v` and `v_vc_sigmas` are those of the second meter, which measures V_Vc. The ages are
    times since calibration, `..._from` says where they are from. `bias_instability_dof` are the degrees of freedom of
    its square; None: as many as one likes.
    The rest is that of ``[uncertainty]``.
    """

    meter_gain: float | None = None
    meter_offset_v: float | None = None
    meter_sigmas: float | None = None
    meter_age_days: float = 365.0
    meter_age_from: str = "assumed"
    generator_gain: float | None = None
    generator_offset_v: float | None = None
    generator_ranges_v: tuple[float, ...] = ()
    generator_reach_v: float = 0.0
    generator_bits: int = 0
    v_vc_gain: float | None = None
    v_vc_offset_v: float | None = None
    v_vc_sigmas: float | None = None
    meter_gain_correction: float = 0.0
    meter_offset_correction_v: float = 0.0
    v_vc_gain_correction: float = 0.0
    v_vc_offset_correction_v: float = 0.0
    v_vc_meter_age_days: float = 365.0
    v_vc_meter_age_from: str = "assumed"
    table_rate: float | None = None
    bias_instability_deg_h: float | None = None
    bias_instability_dof: float | None = None
    bias_instability_from: str = "uncertainty.bias_instability_deg_h"
    horizon_h: float = 24.0
    temperature_k: float | None = None
    scale_factor_ppm_k: float | None = None
    bias_deg_h_k: float | None = None
    warm_up_k: float | None = None
    warm_up_time_s: float = 900.0
    misalignment_deg: float | None = None
    carrier_phase_deg: float | None = None
    demodulator_phase_deg: float | None = None
    k_vc_ppm_carrier_deg: float = 1000.0
    k_vc_ppm_demodulator_deg: float = 100.0
    scale_factor_ppm_demodulator_deg: float = 1000.0
    bias_deg_s_demodulator_deg: float | None = None
    k_vc_drift_ppm_per_year: float = 0.0
    k_vc_on_the_way_ppm: float = 0.0
    k_vc_not_measured_ppm: float | None = None
    output_ohm: float = 0.0
    oscilloscope_gain_error: float = 0.02
    exchanged_ratio_ppm: float = 10.0
    assumed: dict[str, str] = field(default_factory=dict)

    @property
    def corrects(self) -> bool:
        """True where a certificate of a meter adds anything to its readings."""
        return any(getattr(self, key) for key in _CORRECTIONS)

    def corrected(self, output_v: Any) -> Any:
        """Return a reading of the multimeter, or an array of them, with its certificate's correction, V."""
        return output_v + self.meter_gain_correction * output_v + self.meter_offset_correction_v

    def v_vc_corrected(self, v_vc_v: Any) -> Any:
        """Return a corrected reading of the meter on V_Vc."""
        return v_vc_v + self.v_vc_gain_correction * v_vc_v + self.v_vc_offset_correction_v

    def corrected_point(self, point: "Point") -> "Point":
        """Return a point with the certificates' corrections of both of its voltages."""
        v_vc_v = point.v_vc_measured_v
        measured_v = None if v_vc_v is None else self.v_vc_corrected(v_vc_v)
        return structs.replace(point, output_v=self.corrected(point.output_v), v_vc_measured_v=measured_v)

    def gaps(self) -> Iterator[Gap]:
        """Yield the contributions that are not known."""
        for key, gap in GAPS.items():
            idle = key == "bias_deg_s_demodulator_deg" and not self.demodulator_phase_deg
            if getattr(self, key) is None and not idle:
                yield gap

    def missing(self, kind: str) -> tuple[str, ...]:
        """Return the names of the contributions missing in a value of `kind` (``k_vc``, ``scale_factor``, ``bias``)."""
        return tuple(gap.name for gap in self.gaps() if gap.leaves_out(kind))


_CORRECTIONS = (
    *("meter_gain_correction", "meter_offset_correction_v"),
    *("v_vc_gain_correction", "v_vc_offset_correction_v"),
)


class Station(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings by the place: wiring, limits, expected values, acceptance; none that a procedure could choose.

    `instruments` are those of the bench file by role, the rate table apart; `meters` what is known of the voltmeters
    beside their data sheets; `latitude_deg` is north positive. `oscilloscope` is what its channels see, None on a bench
    that has none. `meter_resolution_v` is that of one reading at the range and integration time that were chosen, V.
    `sources` are what uncertainties come from. `characteristics` is what earlier runs found of the device, as its
    entries have it, for a calibration of K_Vc. `simulated` is the kind of the bench, None where nobody told: only
    entries from benches of the same kind count.
    """

    instruments: dict[str, PlacedInstrument] = field(default_factory=dict)
    meters: dict[str, MeterKnown] = field(default_factory=dict)
    rails: parts.RailWiring = field(default_factory=parts.RailWiring)
    oscilloscope: parts.OscilloscopeWiring | None = field(default_factory=parts.OscilloscopeWiring)
    mains_hz: Literal[50, 60] = 50
    latitude_deg: float | None = None
    meter_resolution_v: float | None = None
    limits: parts.Limits = field(default_factory=parts.Limits)
    gyro: parts.DeclaredGyro = field(default_factory=parts.DeclaredGyro)
    expected: parts.Expected = field(default_factory=parts.Expected)
    acceptance: parts.AcceptanceLimits = field(default_factory=parts.AcceptanceLimits)
    sources: Sources = field(default_factory=Sources)
    characteristics: dict[str, Any] = field(default_factory=dict)
    simulated: bool | None = None

    @property
    def stream(self) -> "Stream | None":
        """The stream that is the output; None where a multimeter reads it."""
        return self.gyro.stream or None

    @property
    def output_unit(self) -> str:
        """Unit of the output, and of everything that is called its voltage."""
        return self.stream.output_unit if self.stream else "V"

    def sheet_of(self, role: str) -> Any:
        """Return the data sheet of the instrument of `role`, or None."""
        placed = self.instruments.get(role)
        return None if placed is None else data_sheet_of(placed.model)

    def channel_of(self, node: parts.Node) -> int:
        """Return the oscilloscope's channel that sees `node`.

        Raises:
            ConfigError: none does.
        """
        channel = None if self.oscilloscope is None else self.oscilloscope.channel_of(node)
        if channel is None:
            raise ConfigError(f"wiring.oscilloscope: expected a channel on {node!r}, got none")
        return channel


_RATES = "rates of the table, in their order; -5:5:0.5 is a range"


class ProcedureSettings(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The settings that all procedures share. A subclass adds the keys of one procedure, each with a default.

    >>> class HysteresisSettings(vcfbench.ProcedureSettings, frozen=True):
    ...     loops: Annotated[int, Meta(ge=1, le=100, description="times up and down")] = 1
    """

    positive_rail_v: Annotated[bounds.PositiveRail, bounds.said("level of the positive rail")] = 10.0
    negative_rail_v: Annotated[bounds.NegativeRail, bounds.said("level of the negative rail")] = -10.0
    rail_current_limit_a: Annotated[bounds.Current, bounds.said("current limit, set before the outputs go on")] = 0.1
    rail_tolerance_v: Annotated[bounds.VoltageTolerance, bounds.said("tolerance of the read-back of a rail")] = 0.1
    warm_up_s: Annotated[bounds.WarmUp, bounds.said("wait after power-on")] = 0.0
    acceleration_deg_s2: Annotated[bounds.Acceleration, bounds.said("acceleration of every ramp")] = 100.0
    rate_tolerance_deg_s: Annotated[bounds.RateTolerance, bounds.said("tolerance of the read-back of the table")] = 0.05
    rate_deadline_s: Annotated[bounds.Seconds, bounds.said("time for a rate to settle, beyond twice its ramp")] = 10.0
    settle_s: Annotated[bounds.Settling, bounds.said("wait after each step of rate or V_Vc")] = 2.0
    sample_interval_s: Annotated[bounds.Interval, bounds.said("time from reading to reading")] = 1.0
    samples: Annotated[bounds.Samples, bounds.said("readings per mean", option=True)] = 10
    nplc: Annotated[Literal[1, 10, 100], bounds.said("integration time in power-line cycles")] = 10
    meter_range_v: Annotated[Literal[1, 10, 100], bounds.said("fixed range of the multimeter")] = 10
    rates_deg_s: Annotated[bounds.Rates, bounds.said(_RATES, option="--rates")] = PAPER_RATES_DEG_S
    k_vc_guess_deg_s_per_v: Annotated[bounds.Slope, bounds.said("rate that 1 V of V_Vc stands for, roughly")] = 150.0
    drive: parts.DriveWindow = field(default_factory=parts.DriveWindow)
    station: Station = field(default_factory=Station)

    of_device: ClassVar[tuple[str, ...]] = ()
    """Keys to which :meth:`recalled` gives values where nobody did."""
    creeps: ClassVar[bool] = False  # Whether the output may die away with any time constant: it is what is measured
    checked_warm: ClassVar[bool] = True  # Whether the drive is checked when warm, at the temperature of all values
    smooth: ClassVar[bool] = True  # Whether outputs lie along a curve, by which windows are held against each other
    waits: ClassVar[str] = "warm_up_s"  # The key of the wait after power-on

    @property
    def unforeseen(self) -> dict[str, str]:
        """Names of results whose U95 no dry run by these settings can expect, each with why."""
        return {}

    @property
    def start_up_s(self) -> float:
        """Wait after power-on, s: at least that after any other step."""
        return max(self.warm_up_s, self.settle_s)

    @classmethod
    def keys_of_device(cls, dut: str, devices: str | None = None) -> dict[str, Any]:
        """Return the settings that name the device `dut`; none where no setting names a device."""
        return {}

    @property
    def named_device(self) -> str | None:
        """The device that these settings name, None where they name none."""
        return None

    @property
    def early_look(self) -> tuple[str, ...]:
        """Roles of which the first on the bench moves the output before a long wait; none where nothing was told."""
        return ()

    @property
    def k_vc_looked_at(self) -> float | None:
        """A told K_Vc, (deg/s)/V, that is held against table and V_Vc where the bench has both; None: none is."""
        return None

    def require_known_answer(self, slope: float, within: float, *, by_v_vc: bool) -> None:
        """See that the output answers as was told; MeasurementError: it does not.

        `slope` is in V/(deg/s), known to `within`; of V_Vc by `k_vc_guess_deg_s_per_v`.
        """

    @property
    def warm_again_s(self) -> float:
        """Time under power with which a run begins that is resumed after something was measured, s."""
        return self.start_up_s

    @property
    def rails(self) -> tuple[parts.RailSettings, ...]:
        """Settings of the rails; none where the bench has no supply and the device feeds itself."""
        if self.station.instruments and "power" not in self.station.instruments:
            return ()
        wiring, limit_a = self.station.rails, self.rail_current_limit_a
        positive = parts.RailSettings("positive", wiring.positive, self.positive_rail_v, limit_a)
        if wiring.single:
            return (positive,)
        return positive, parts.RailSettings("negative", wiring.negative, self.negative_rail_v, limit_a)

    @property
    def rails_v(self) -> tuple[float, float] | None:
        """Levels of the positive and the negative rail, V, 0 of one that is not there; None without a supply."""
        negative_v = 0.0 if self.station.rails.single else self.negative_rail_v
        return (self.positive_rail_v, negative_v) if self.rails else None

    @property
    def null_v(self) -> float:
        """Output at no rate, from which a bias counts as a rate."""
        return self.station.gyro.null_on(self.rails)

    @property
    def expected(self) -> parts.Expected:
        """Expected values of this gyroscope; a run with others is ended."""
        return self.station.expected

    @property
    def acceptance(self) -> tuple[Limit, ...]:
        """The limits of the results."""
        given = structs.asdict(self.station.acceptance)
        guarded = given.pop("guard_band") == "U95"
        return tuple(Limit(key, window[0], window[1], guarded) for key, window in given.items() if window)

    @property
    def meter_resolution_v(self) -> float:
        """Resolution of one reading, V.

        Raises:
            ConfigError: these settings are those of no multimeter.
        """
        if self.station.meter_resolution_v is None:
            raise ConfigError(
                "the resolution of a reading is not known: the settings are of no bench with a multimeter"
            )
        return self.station.meter_resolution_v

    @property
    def aperture_s(self) -> float:
        """Integration time of one reading, s."""
        stream = self.station.stream
        return stream.aperture_s if stream else self.nplc / self.station.mains_hz

    @property
    def fastest_deg_s(self) -> float:
        """The largest commanded rate of the table, deg/s, either way."""
        return max(map(abs, self.rates_deg_s))

    def expected_gyro(self) -> LinearGyro:
        """Return the gyro that the bench file expects: the middle of each window, or the guess of K_Vc."""
        expected = self.expected
        usual = {"V": -0.0125, "deg/s": 1.0}.get(self.station.output_unit, 100.0)
        return LinearGyro(
            self.k_vc_guess_deg_s_per_v
            if expected.k_vc_deg_s_per_v is None
            else parts.middle(expected.k_vc_deg_s_per_v),
            usual if expected.scale_factor_v_per_deg_s is None else parts.middle(expected.scale_factor_v_per_deg_s),
            0.0 if expected.bias_v is None else parts.middle(expected.bias_v),
        )

    def made_plain(self) -> Self:
        """Return these settings with values that follow from others written out; most have none of the kind."""
        return self

    def recalled(self) -> Self:
        """Return these settings with named values looked up: asked for once, before anything is opened.

        A procedure that builds on what is kept of a device puts it into its settings here, so that the record holds all
        that its results are made of.

        Raises:
            ConfigError: what they name is not there.
        """
        return self

    def contradictions(self) -> Iterator[InvalidValue]:
        """Yield the contradictions between values, or with the limits of the station."""
        yield from lost_digits(structs.replace(self, station=UNSET), "")
        yield from self.drive.contradictions()
        if len(set(self.rates_deg_s)) < 3:
            yield InvalidValue("rates_deg_s", "at least three different rates", list(self.rates_deg_s))
        if self.k_vc_guess_deg_s_per_v == 0.0:
            yield InvalidValue("k_vc_guess_deg_s_per_v", "a number that is not 0", self.k_vc_guess_deg_s_per_v)
        if self.station.rails.positive == "P6V" and self.positive_rail_v > 6.18:  # E3631A: programming range of +6 V
            yield InvalidValue("positive_rail_v", "at most 6.18 V from output P6V", self.positive_rail_v)
        reading_s = 2.0 * self.nplc / self.station.mains_hz  # with its autozero it is two integration times long
        if stream := self.station.stream:
            reading_s = stream.reading_s
            if reading_s > self.sample_interval_s:
                expected = f"at least {reading_s:g} s, which the frames of a reading take (gyro.stream.aperture_s)"
                yield InvalidValue("sample_interval_s", expected, self.sample_interval_s)
        elif reading_s > self.sample_interval_s:
            expected = f"at least {reading_s:g} s, which a reading of {self.nplc} power-line cycles with autozero takes"
            yield InvalidValue("sample_interval_s", expected, self.sample_interval_s)
        yield from self._beyond(self.station.limits)

    def beyond_table(self, key: str, rate_deg_s: float) -> Iterator[InvalidValue]:
        """Yield the value of `key` where it is faster than the table may turn, or than the numbers of a stream go."""
        limit_deg_s, stream = self.station.limits.max_rate_deg_s, self.station.stream
        if limit_deg_s is not None and abs(rate_deg_s) > limit_deg_s:
            yield InvalidValue(key, rate_words(limit_deg_s), rate_deg_s)
        elif stream and (stream.unit != "LSB" or self.expected.scale_factor_v_per_deg_s):
            largest_deg_s = stream.largest / abs(self.expected_gyro().scale_factor)
            if abs(rate_deg_s) > largest_deg_s:
                expected = f"a rate of at most {largest_deg_s:.4g} deg/s either way, the largest of {stream.name}"
                yield InvalidValue(key, expected, rate_deg_s)

    def _beyond(self, limits: parts.Limits) -> Iterator[InvalidValue]:
        """Yield the values beyond the limits of the station; it has those of its instruments."""
        for index, rate_deg_s in enumerate(self.rates_deg_s):
            yield from self.beyond_table(f"rates_deg_s[{index}]", rate_deg_s)
        fastest, current_a = limits.max_acceleration_deg_s2, limits.max_rail_current_a
        if fastest is not None and self.acceleration_deg_s2 > fastest:
            expected = f"at most {fastest:g} deg/s^2 (limits.max_acceleration_deg_s2)"
            yield InvalidValue("acceleration_deg_s2", expected, self.acceleration_deg_s2)
        if current_a is not None and self.rail_current_limit_a > current_a:
            expected = f"at most {current_a:g} A (limits.max_rail_current_a)"
            yield InvalidValue("rail_current_limit_a", expected, self.rail_current_limit_a)
        low_v, high_v = limits.min_rail_v, limits.max_rail_v
        if low_v is None or high_v is None:
            return
        window = f"a rail of {low_v:g} to {high_v:g} V either sign (limits)"
        for key, voltage_v in ((f"{rail.rail}_rail_v", rail.voltage_v) for rail in self.rails):
            if not low_v <= abs(voltage_v) <= high_v:
                yield InvalidValue(key, window, voltage_v)


class DeviceSettings(ProcedureSettings, frozen=True, kw_only=True):
    """Settings of procedures that keep or know something of a device."""

    dut: Annotated[
        Annotated[str, Meta(min_length=1, max_length=200)] | None,
        bounds.said("serial number of the gyroscope, as --dut: its device history is used and extended"),
    ] = None
    devices: Annotated[
        str, Meta(min_length=1, description="directory of the device history", extra={"option": True})
    ] = "devices"

    @classmethod
    def keys_of_device(cls, dut: str, devices: str | None = None) -> dict[str, Any]:
        """Return the keys of the device, and of the store's directory if given."""
        return {"dut": dut} | ({} if devices is None else {"devices": devices})

    @property
    def named_device(self) -> str | None:
        """The device under whose serial number it is kept or known."""
        return self.dut


def rate_words(limit_deg_s: float) -> str:
    """Say which rates the station bears."""
    return f"a rate of at most {limit_deg_s:g} deg/s either way (limits.max_rate_deg_s)"
