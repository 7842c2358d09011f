"""Description of a bench: roles, wiring, limits, site, and its simulation.

A bench file decodes into these frozen structs and nothing else; every range is in the type (`bounds`). What a station
must decide itself (resources, limits, latitude) has no default. Every role may be missing, and with it its limits.
Settings of procedures are those of their own classes (:mod:`vcfbench.station.settings`).
"""

from collections.abc import Sequence
from datetime import date
from operator import index
from typing import Annotated, Any, Literal, Self

from msgspec import UNSET, Meta, UnsetType, field
from msgspec.structs import replace

from vcfbench import strict
from vcfbench.drivers.streams.description import Stream
from vcfbench.drivers.wire import behind, is_simulated
from vcfbench.errors import ConfigError
from vcfbench.models import rail_terminals
from vcfbench.station import bounds, parts
from vcfbench.station.layering import shared_settings
from vcfbench.station.settings import ProcedureSettings

Name = Annotated[str, Meta(pattern=strict.NAME_PATTERN)]
Dialect = Annotated[str, Meta(min_length=1, max_length=4096, pattern=bounds.LINE_PATTERN)]
"""Which languages there are is checked beside the description: other packages may bring theirs."""

Text = Annotated[str, Meta(min_length=1, max_length=200, pattern=bounds.LINE_PATTERN)]
Model = Annotated[str, Meta(pattern=strict.NAME_PATTERN)]
"""Which models a role takes is checked beside the description: other packages may bring theirs."""

Resource = Annotated[str, Meta(min_length=1, max_length=200, pattern=bounds.LINE_PATTERN)]
Errors = Literal["none", "drawn"] | dict[str, Any]


class SerialSettings(parts.BenchFileTable, frozen=True, kw_only=True):
    """The line of an instrument on a serial port (``ASRL``); instruments on other interfaces ignore it."""

    baud_rate: bounds.BaudRate = 9600
    data_bits: Annotated[int, Meta(ge=7, le=8)] = 8
    parity: Literal["none", "even", "odd"] = "none"
    stop_bits: Annotated[int, Meta(ge=1, le=2)] = 2
    flow_control: Literal["none", "dtr_dsr", "rts_cts", "xon_xoff"] = "dtr_dsr"


class _Calibrated(parts.BenchFileTable, frozen=True, kw_only=True):
    """Calibration of an instrument: its date, the date it is due, and the number of its certificate; for the record.

    `inventory_number` is what is written on it: some instruments report no serial number.
    """

    calibrated: date | None = None
    calibration_due: date | None = None
    certificate: Text | None = None
    inventory_number: Text | None = None


CALIBRATION_KEYS = (*_Calibrated.__struct_fields__, "calibration", "calibration_dcc")
"""Keys of a role that no driver is told."""


class VisaRole(_Calibrated, frozen=True, kw_only=True):
    """An instrument reached through VISA; generators and chamber have no further keys."""

    resource: Resource
    timeout_s: bounds.Seconds = 5.0
    serial_number: Text | None = None
    serial: SerialSettings | None = None
    serial_pause_s: bounds.Pause | None = None
    like: Model | None = None
    """The model whose words it speaks, where its own is not known; its identity must still be that of `model`."""
    model: Model


By = Literal["hand"] | None
"""Who sets and reads an instrument: a person, or the program."""


class PowerRole(VisaRole, frozen=True, kw_only=True):
    """The supply of the PCB's rails."""

    by: By = None


class MultimeterRole(VisaRole, frozen=True, kw_only=True):
    """A voltmeter: of the output V_open, or of V_Vc; `calibration` are the values of its certificate.

    It may stand in a file, the certificate's XML (`calibration_dcc`), which is read with the bench file.
    """

    calibration: tuple[parts.CalibrationPoint, ...] = ()
    calibration_dcc: Dialect | None = None


class OutputMeterRole(MultimeterRole, frozen=True, kw_only=True):
    """The voltmeter of the output; read by hand, `resolution_v` is the step of the last digit that is typed."""

    by: By = None
    resolution_v: Annotated[float, Meta(ge=1e-9, le=1.0)] | None = None


class OscilloscopeRole(VisaRole, frozen=True, kw_only=True):
    """The oscilloscope; `probe` is the ratio of its probes, which every used channel must have."""

    probe: Annotated[float, Meta(ge=0.1, le=1000.0)] = 1.0


class RateTableRole(_Calibrated, frozen=True, kw_only=True):
    """The single-axis rate table: a dialect on a serial port, or on anything pyserial opens by URL."""

    dialect: Dialect
    resource: Resource
    model: Text | None = None
    by: By = None
    timeout_s: bounds.Seconds = 2.0
    axis: Annotated[int, Meta(ge=1, le=6)] = 1
    axis_sign: Literal[1, -1] = 1
    baud_rate: bounds.BaudRate | None = None
    reply_header: Literal["auto", "none", "u32le2", "u32be2"] = "auto"
    steps_per_deg: bounds.StepsPerDegree | None = None


class Wiring(parts.BenchFileTable, frozen=True, kw_only=True):
    """Connections between the instruments and the PCB."""

    rails: parts.RailWiring = field(default_factory=parts.RailWiring)
    oscilloscope: parts.OscilloscopeWiring = field(default_factory=parts.OscilloscopeWiring)
    multimeter: parts.Node = "output"
    v_vc_meter: parts.Node = "v_vc"


class Site(parts.BenchFileTable, frozen=True, kw_only=True):
    """Site of the bench: for the Earth's rate, the voltmeter's integration time, and the room's temperature."""

    latitude_deg: bounds.Latitude
    mains_hz: Literal[50, 60] = 50
    ambient_c: bounds.RoomWindow | None = None


class Laboratory(parts.BenchFileTable, frozen=True, kw_only=True):
    """Laboratory that owns the bench, for records and reports; `operator` is the default operator.

    `country` is two capital letters (ISO 3166-1), for certificates. `signing_key` is the file of the private key that
    signs records, from where the bench file is.
    """

    name: Text | None = None
    address: Text | None = None
    country: Annotated[str, Meta(pattern="^[A-Z]{2}$")] | None = None
    email: Text | None = None
    operator: Text | None = None
    signing_key: Text | None = None


class Notify(parts.BenchFileTable, frozen=True, kw_only=True):
    """A program, with its arguments, that gets the outcome of each run within `timeout_s`."""

    command: Annotated[tuple[Annotated[str, Meta(min_length=1, max_length=4096)], ...], Meta(min_length=1)]
    timeout_s: Annotated[float, Meta(ge=0.1, le=60.0)] = 10.0


class Knowledge(parts.BenchFileTable, frozen=True, kw_only=True):
    """Properties of instruments and gyroscope for the uncertainties.

    What is not given is taken at the worst of its class (:data:`vcfbench.specifications.WORST_OF_CLASS`), or the values
    are incomplete without it; results say which.

    `meter_age_days` is the time since the multimeter was calibrated, `v_vc_meter_age_days` since the meter on V_Vc
    was; where they are not given it is that from the day in the meter's table (`calibrated`) to the run, else a year.
    `table_rate_error` is the largest relative error of the table's rate, `bias_instability_deg_h` the gyroscope's
    coefficient B of a zero record, and `horizon_h` the time over which a bias is a statement.

    `generator_error` and `generator_offset_v` are the largest errors of a level of V_Vc, relative and in volts of the
    open generator, where it is known better than by its data sheet. `generator_ranges_v` are the largest levels of its
    ranges, V, where they are known: on each gain and offset are the same at all levels. A data sheet does not
    tell them; without them each value is taken to have the ranges that make it least certain.

    `temperature_k` is how far the gyroscope's temperature may be from that for which values are stated, `warm_up_k` how
    far it is from it at power-on, `warm_up_time_s` the time constant; `scale_factor_ppm_k` and `bias_deg_h_k` what a
    kelvin does. `misalignment_deg` is the largest angle between the gyroscope's axis and the table's.

    `carrier_phase_deg` and `demodulator_phase_deg` are how far the phases of carrier and demodulator may be from those
    for which values are stated. `k_vc_ppm_carrier_deg`, `k_vc_ppm_demodulator_deg`, `scale_factor_ppm_demodulator_deg`
    and `bias_deg_s_demodulator_deg` are what a degree of either does, as `phase` measures it; 1000 and 100 ppm
    are those of the paper's gyroscope, whose demodulated signal is 3.28 degrees from ideal.

    `k_vc_drift_ppm_per_year` is the most by which K_Vc may drift in a year through what nobody sees without a table:
    combs, their gap and charges, masses. Without it the class of the device counts (assumed). `k_vc_on_the_way_ppm` is
    the most by which it may have changed from the table to where it is used, whenever that was: 0 where it never left.

    `k_vc_not_measured_ppm` is the most by which K_Vc may have changed through what a self-calibration could have
    measured and did not (Q, modes, phases, feed-through, amplitudes). Without it each counts as far as ageing goes
    (assumed).

    `meter_limits`: limits of a voltmeter's data sheet are as many standard deviations as its maker says (four of a
    34401A), or any error within them is as likely. `output_ohm` is the largest resistance of the gyroscope's output,
    which the multimeter loads with its own: above 10 Gohm on ranges up to 10 V, 10 Mohm on the others and of a meter
    that a person reads.

    `oscilloscope_gain_error` is the largest error of a channel with its probe, which on another day may be another one;
    0.02 is a DSO7104B's of full scale. `exchanged_ratio_ppm` is what is left in the ratio of two amplitudes whose
    probes were exchanged: how far the converter's steps leave a mean of another size (assumed).
    """

    meter_age_days: bounds.MeterAge | None = None
    v_vc_meter_age_days: bounds.MeterAge | None = None
    table_rate_error: bounds.TableRateError | None = None
    generator_error: bounds.LevelError | None = None
    generator_offset_v: bounds.LevelOffset | None = None
    generator_ranges_v: bounds.GeneratorRanges | None = None
    bias_instability_deg_h: bounds.BiasInstability | None = None
    horizon_h: bounds.Horizon = 24.0
    temperature_k: bounds.Kelvins | None = None
    scale_factor_ppm_k: bounds.ScaleFactorCoefficient | None = None
    bias_deg_h_k: bounds.BiasCoefficient | None = None
    warm_up_k: bounds.Kelvins | None = None
    warm_up_time_s: bounds.WarmUpTime | None = None
    misalignment_deg: bounds.Misalignment | None = None
    carrier_phase_deg: bounds.PhaseLimit | None = None
    demodulator_phase_deg: bounds.PhaseLimit | None = None
    k_vc_ppm_carrier_deg: bounds.PpmPerDegree = 1000.0
    k_vc_ppm_demodulator_deg: bounds.PpmPerDegree = 100.0
    scale_factor_ppm_demodulator_deg: bounds.PpmPerDegree = 1000.0
    bias_deg_s_demodulator_deg: bounds.BiasPerDegree | None = None
    k_vc_drift_ppm_per_year: bounds.PpmPerYear | None = None
    k_vc_on_the_way_ppm: bounds.PpmPerYear | None = None
    k_vc_not_measured_ppm: bounds.PpmPerYear | None = None
    meter_limits: Literal["sheet", "rectangular"] = "sheet"
    output_ohm: bounds.OutputResistance | None = None
    oscilloscope_gain_error: bounds.LevelError = 0.02
    exchanged_ratio_ppm: bounds.PpmPerYear = 10.0


class SimulationErrors(parts.BenchFileTable, frozen=True, kw_only=True):
    """The imperfections of each simulated instrument.

    Each is ``"none"`` (ideal), ``"drawn"`` (from the published accuracy, by the seed) or a table of individual errors
    by name, the others none; with ``drawn = 0.25`` in the table they are drawn, a quarter as large.
    """

    power: Errors = "drawn"
    rate_source: Errors = "drawn"
    multimeter: Errors = "drawn"
    oscilloscope: Errors = "drawn"
    rate_table: Errors = "drawn"
    vibration_source: Errors = "drawn"
    v_vc_meter: Errors = "drawn"
    chamber: Errors = "drawn"


LARGEST_SEED = 2**63 - 1


def whole_seed(seed: object) -> int:
    """Return a seed from a script or a command, numpy's numbers too; raises ConfigError for anything else."""
    try:
        whole = index(seed)  # type: ignore[arg-type]  # what has no index raises
    except TypeError:
        whole = -1
    if not 0 <= whole <= LARGEST_SEED:
        raise ConfigError(f"--seed {seed!r}: expected a whole number from 0 to {LARGEST_SEED}")
    return whole


class Simulation(parts.BenchFileTable, frozen=True, kw_only=True):
    """Simulation behind the resources of a bench; a bench file without it is a real station."""

    parameters: Literal["paper", "ideal"] = "paper"
    seed: Annotated[int, Meta(ge=0, le=LARGEST_SEED)] = 0
    errors: SimulationErrors = field(default_factory=SimulationErrors)
    override: dict[str, Any] = field(default_factory=dict)


class Served(parts.BenchFileTable, frozen=True, kw_only=True):
    """A simulated bench in another process (``vcfbench sim serve``): real wires to it, and its clock is there.

    Runs lead its time, unless `clock` is "wall": beside something that has its own, they wait as on a real bench.
    """

    control: Annotated[str, Meta(pattern=strict.ADDRESS_PATTERN)]
    clock: Literal["wall"] | None = None

    def address(self) -> tuple[str, int]:
        """Return host and port of the control port."""
        host, _, port = self.control.rpartition(":")
        return host.strip("[]"), int(port)


class Safety(parts.BenchFileTable, frozen=True, kw_only=True):
    """Reaction of a run to the death of its watchdog, and the time for which scripts may give no sign of life.

    `watchdog_lost`: stop, or go on with nobody there should the program die too. `script_silent_s`: for how long a
    program that has opened the bench itself may do nothing but work something out, while something drives.
    """

    watchdog_lost: Literal["stop", "go on"] = "stop"
    script_silent_s: Annotated[float, Meta(ge=2.0, le=3600.0)] = 10.0


class Device(parts.BenchFileTable, frozen=True, kw_only=True):
    """One of several gyroscopes on the bench: its own tables of the bench file, filled in."""

    name: Text
    multimeter: OutputMeterRole
    gyro: parts.DeclaredGyro
    expected: parts.Expected
    acceptance: parts.AcceptanceLimits
    uncertainty: Knowledge
    simulation: Simulation | None = None


class BenchDescription(parts.BenchFileTable, frozen=True, kw_only=True):
    """One station, as its bench file describes it, defaults filled in; a role that the station has not is None.

    >>> station = vcfbench.load_bench("lab.toml")
    >>> station.name, station.simulated, station.multimeter.model
    ('paper', True, '34401A')
    """

    name: Name
    title: Text = "a bench"
    visa_library: Text = "@py"
    power: PowerRole | None = None
    rate_source: VisaRole | None = None
    multimeter: OutputMeterRole | None = None
    oscilloscope: OscilloscopeRole | None = None
    rate_table: RateTableRole | None = None
    vibration_source: VisaRole | None = None
    v_vc_meter: MultimeterRole | None = None
    chamber: VisaRole | None = None
    wiring: Wiring = field(default_factory=Wiring)
    limits: parts.Limits = field(default_factory=parts.Limits)
    site: Site
    procedure_table: dict[str, Any] = field(default_factory=dict, name="procedure")
    """``[procedure]`` as it stands in the bench file: settings of all procedures, and a table for each that has some
    of its own; :mod:`vcfbench.procedures.layers` makes settings of it."""

    gyro: parts.DeclaredGyro = field(default_factory=parts.DeclaredGyro)
    expected: parts.Expected = field(default_factory=parts.Expected)
    acceptance: parts.AcceptanceLimits = field(default_factory=parts.AcceptanceLimits)
    uncertainty: Knowledge = field(default_factory=Knowledge)
    laboratory: Laboratory = field(default_factory=Laboratory)
    notify: Notify | None = None
    safety: Safety = field(default_factory=Safety)
    simulation: Simulation | None = None
    served: Served | None = None
    devices: tuple[Device, ...] | UnsetType = UNSET
    """Of a bench with several gyroscopes all of them, the first of which stands above; else records say nothing."""

    @property
    def several(self) -> tuple[str, ...]:
        """Names of the gyroscopes of a bench that has more than one."""
        return tuple(each.name for each in self.devices or ())

    def of_device(self, name: str) -> Self:
        """Return the bench of one of several gyroscopes, without the others."""
        own = next(each for each in self.devices or () if each.name == name)
        kept = {key: getattr(own, key) for key in own.__struct_fields__ if key != "name"}
        return replace(self, **kept, devices=UNSET)

    def with_devices(self, names: Sequence[str], of: Sequence[Self]) -> Self:
        """Return the bench with several gyroscopes, each on a bench `of` its own; the first is this one."""
        kept = [key for key in Device.__struct_fields__ if key != "name"]
        both = zip(names, of, strict=True)
        return replace(
            self, devices=tuple(Device(name=name, **{key: getattr(own, key) for key in kept}) for name, own in both)
        )

    @property
    def each(self) -> tuple[Self, ...]:
        """The benches of the gyroscopes: itself for a single one."""
        return tuple(map(self.of_device, self.several)) or (self,)

    @property
    def output_resource(self) -> str:
        """Resource of the output, or "" without one."""
        return "" if self.multimeter is None else self.multimeter.resource

    @property
    def procedure(self) -> ProcedureSettings:
        """Settings of ``[procedure]`` for every procedure, defaults filled in."""
        return shared_settings(self.procedure_table, self.name)

    def owned(self, role: str) -> str:
        """Return the exclusive resource of `role`: its own, or its GPIB adapter's."""
        resource: str = getattr(self, role).resource
        return behind(resource, self.visa_library)[0] or resource

    @property
    def by_hand(self) -> tuple[str, ...]:
        """Roles that a person performs; none where the program is the hands of a simulation."""
        parts = {role: getattr(self, role) for role in ("power", "multimeter", "rate_table")}
        return () if self.steered else tuple(role for role, part in parts.items() if part and part.by)

    @property
    def stream(self) -> Stream | None:
        """The stream of numbers that the gyroscope speaks; None where a multimeter reads its output."""
        return self.gyro.stream or None

    @property
    def stream_resources(self) -> dict[str, str]:
        """Resources of the streams by the roles of their simulated instruments: ``multimeter``, ``multimeter-2``..."""
        if not self.stream:
            return {}
        found: dict[str, str] = {}
        for number, each in enumerate(self.each, 1):
            if each.output_resource not in found.values():
                found["multimeter" if number == 1 else f"multimeter-{number}"] = each.output_resource
        return found

    @property
    def rails_at(self) -> str:
        """Terminals of the supply that the rails of the PCB are connected to, in words; empty: it has no supply."""
        rails, power = self.wiring.rails, self.power
        return rail_terminals(power.model, power.like, rails.positive, rails.negative) if power else ""

    @property
    def simulated(self) -> bool:
        """Return True if an instrument is simulated, in this process or another, or by how it is opened."""
        table = () if self.rate_table is None else (self.rate_table.resource,)
        opened = (self.visa_library, *table, *(each.output_resource for each in self.each))
        return self.simulation is not None or self.served is not None or any(map(is_simulated, opened))

    @property
    def steered(self) -> bool:
        """Return True if runs steer the simulation, its clock and its hands: ``[simulation]``, ``[served]`` so led."""
        return self.simulation is not None or (self.served is not None and self.served.clock is None)
