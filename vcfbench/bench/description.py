"""What a bench is: roles, wiring, limits, site, and what stands in for it when simulated.

A bench file decodes into these frozen structs and nothing else; every range is in the type (`bounds`). What a station
must decide itself (resources, limits, latitude) has no default. Every role may be missing, and with it its limits.
Settings of procedures are those of their own classes (:mod:`vcfbench.procedures.settings`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal

from msgspec import Meta, Struct, field

from vcfbench.bench.bounds import (  # noqa: TC001 - msgspec reads them
    Acceleration,
    BaudRate,
    Current,
    Latitude,
    LeastRail,
    NoiseWindow,
    OutputDrift,
    OutputSlopeWindow,
    OutputWindow,
    Pause,
    PercentWindow,
    PositiveRail,
    PpmWindow,
    RateLimit,
    RateWindow,
    Seconds,
    SlopeWindow,
    StepsPerDegree,
    Temperature,
    TemperatureRamp,
    VVcLimit,
)
from vcfbench.errors import LimitError

if TYPE_CHECKING:
    from vcfbench.procedures.settings import ProcedureSettings

__all__ = [
    "Acceptance",
    "BenchDescription",
    "ChamberRole",
    "Expected",
    "FunctionGeneratorRole",
    "Limits",
    "MultimeterRole",
    "Node",
    "OscilloscopeRole",
    "OscilloscopeWiring",
    "PowerRole",
    "RailWiring",
    "RateTableRole",
    "SerialSettings",
    "Served",
    "Simulation",
    "SimulationErrors",
    "Site",
    "SupplyOutput",
    "Window",
    "Wiring",
]

Node = Literal["output", "v_vc", "drive", "carrier", "sense", "rail_positive", "rail_negative"]
SupplyOutput = Literal["P6V", "P25V", "N25V"]
Window = tuple[float, float]
LimitKey = Literal[
    "max_rate_deg_s",
    "max_acceleration_deg_s2",
    "max_v_vc_v",
    "min_rail_v",
    "max_rail_v",
    "max_rail_current_a",
    "min_temperature_c",
    "max_temperature_c",
    "max_ramp_k_min",
]

NAME_PATTERN = r"\A[A-Za-z0-9][A-Za-z0-9_.-]{0,63}\Z"
ADDRESS_PATTERN = r"\A(?:[^\s:\[\]]+|\[[0-9A-Fa-f:]+\]):[0-9]{1,5}\Z"
LINE_PATTERN = r"\A[^\x00-\x1f\x7f\x85\u2028\u2029]+\Z"

Name = Annotated[str, Meta(pattern=NAME_PATTERN)]
Dialect = Annotated[str, Meta(min_length=1, max_length=4096, pattern=LINE_PATTERN)]
"""Which languages there are is checked beside the description: other packages may bring theirs."""

Text = Annotated[str, Meta(min_length=1, max_length=200, pattern=LINE_PATTERN)]
Model = Annotated[str, Meta(pattern=NAME_PATTERN)]
"""Which models a role takes is checked beside the description: other packages may bring theirs."""

Resource = Annotated[str, Meta(min_length=1, max_length=200, pattern=LINE_PATTERN)]
Errors = Literal["none", "drawn"] | dict[str, Any]


class _Part(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of the bench file: frozen, strict."""


class SerialSettings(_Part, frozen=True, kw_only=True):
    """The line of an instrument on a serial port (``ASRL``); instruments on other interfaces ignore it."""

    baud_rate: BaudRate = 9600
    data_bits: Annotated[int, Meta(ge=7, le=8)] = 8
    parity: Literal["none", "even", "odd"] = "none"
    stop_bits: Annotated[int, Meta(ge=1, le=2)] = 2
    flow_control: Literal["none", "dtr_dsr", "rts_cts", "xon_xoff"] = "dtr_dsr"


class _VisaRole(_Part, frozen=True, kw_only=True):
    """An instrument reached through VISA."""

    resource: Resource
    timeout_s: Seconds = 5.0
    serial_number: Text | None = None
    serial: SerialSettings | None = None
    serial_pause_s: Pause | None = None
    like: Model | None = None
    """The model whose words it speaks, where its own is not known; its identity must still be that of `model`."""


class PowerRole(_VisaRole, frozen=True, kw_only=True):
    """The supply of the PCB's rails."""

    model: Model


class FunctionGeneratorRole(_VisaRole, frozen=True, kw_only=True):
    """A generator: of the virtual rate's voltage V_Vc, or of the virtual vibration."""

    model: Model


class MultimeterRole(_VisaRole, frozen=True, kw_only=True):
    """A voltmeter: of the output V_open, or of V_Vc."""

    model: Model


class OscilloscopeRole(_VisaRole, frozen=True, kw_only=True):
    """The oscilloscope that watches drive, carrier and sense."""

    model: Model


class ChamberRole(_VisaRole, frozen=True, kw_only=True):
    """What brings the gyroscope to a temperature."""

    model: Model


class RateTableRole(_Part, frozen=True, kw_only=True):
    """The single-axis rate table: a dialect on a serial port, or on anything pyserial opens by URL."""

    dialect: Dialect
    resource: Resource
    timeout_s: Seconds = 2.0
    axis: Annotated[int, Meta(ge=1, le=6)] = 1
    axis_sign: Literal[1, -1] = 1
    baud_rate: BaudRate | None = None
    reply_header: Literal["auto", "none", "u32le2", "u32be2"] = "auto"
    steps_per_deg: StepsPerDegree | None = None


class RailWiring(_Part, frozen=True, kw_only=True):
    """Which supply output feeds which rail of the PCB."""

    positive: SupplyOutput = "P25V"
    negative: SupplyOutput = "N25V"


class OscilloscopeWiring(_Part, frozen=True, kw_only=True):
    """Which node of the PCB each oscilloscope channel sees."""

    channel_1: Node | None = "drive"
    channel_2: Node | None = "carrier"
    channel_3: Node | None = "sense"
    channel_4: Node | None = "output"

    def channels(self) -> dict[int, Node]:
        """Return the wired channels: number to node."""
        nodes = (self.channel_1, self.channel_2, self.channel_3, self.channel_4)
        return {number: node for number, node in enumerate(nodes, start=1) if node is not None}

    def channel_of(self, node: Node) -> int | None:
        """Return the lowest channel that sees `node`, None when none does."""
        return next((number for number, seen in self.channels().items() if seen == node), None)


class Wiring(_Part, frozen=True, kw_only=True):
    """What is connected to what."""

    rails: RailWiring = field(default_factory=RailWiring)
    oscilloscope: OscilloscopeWiring = field(default_factory=OscilloscopeWiring)
    multimeter: Node = "output"
    v_vc_meter: Node = "v_vc"


class Limits(_Part, frozen=True, kw_only=True):
    """What must never be exceeded on this station; checked before anything is sent.

    Those of an instrument that the bench has are there; those of one that it has not may be None.
    """

    max_rate_deg_s: RateLimit | None = None
    max_acceleration_deg_s2: Acceleration | None = None
    max_v_vc_v: VVcLimit | None = None
    min_rail_v: LeastRail | None = None
    max_rail_v: PositiveRail | None = None
    max_rail_current_a: Current | None = None
    min_temperature_c: Temperature | None = None
    max_temperature_c: Temperature | None = None
    max_ramp_k_min: TemperatureRamp | None = None

    def of(self, key: LimitKey) -> float:
        """Return the limit called `key`; LimitError where the station has none, for then nothing is allowed."""
        limit: float | None = getattr(self, key)
        if limit is None:
            raise LimitError(f"the bench has no limit for this, so nothing is allowed (limits.{key})")
        return limit


class Site(_Part, frozen=True, kw_only=True):
    """Where the bench stands: for the Earth's rate, and for the voltmeter's integration time."""

    latitude_deg: Latitude
    mains_hz: Literal[50, 60] = 50


class Expected(_Part, frozen=True, kw_only=True):
    """What this gyroscope should show: a run that shows something else is ended. Each window ``[low, high]``."""

    scale_factor_v_per_deg_s: OutputSlopeWindow | None = None
    bias_v: OutputWindow | None = None
    k_vc_deg_s_per_v: SlopeWindow | None = None
    reading_noise_v: NoiseWindow | None = None
    zero_drift_v: OutputDrift | None = None


class Acceptance(_Part, frozen=True, kw_only=True):
    """Limits of the results, each ``[low, high]``: a run whose results are outside has failed, with exit code 1."""

    scale_factor_v_per_deg_s: OutputSlopeWindow | None = None
    bias_v: OutputWindow | None = None
    bias_deg_s: RateWindow | None = None
    nonlinearity_ppm: PpmWindow | None = None
    reading_noise_v: NoiseWindow | None = None
    k_vc_deg_s_per_v: SlopeWindow | None = None
    scale_factor_error_percent: PercentWindow | None = None


class SimulationErrors(_Part, frozen=True, kw_only=True):
    """The imperfections of each simulated instrument.

    Each is ``"none"`` (ideal), ``"drawn"`` (from the published accuracy, by the seed) or a table of individual errors
    by name, the others none.
    """

    power: Errors = "drawn"
    rate_source: Errors = "drawn"
    multimeter: Errors = "drawn"
    oscilloscope: Errors = "drawn"
    rate_table: Errors = "drawn"
    vibration_source: Errors = "drawn"
    v_vc_meter: Errors = "drawn"
    chamber: Errors = "drawn"


class Simulation(_Part, frozen=True, kw_only=True):
    """What stands behind the resources of a simulated bench; a bench file without it is a real station."""

    parameters: Literal["paper", "ideal"] = "paper"
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    errors: SimulationErrors = field(default_factory=SimulationErrors)
    override: dict[str, Any] = field(default_factory=dict)


class Served(_Part, frozen=True, kw_only=True):
    """A simulated bench in another process (``vcfbench sim serve``): real wires to it, and its clock is there."""

    control: Annotated[str, Meta(pattern=ADDRESS_PATTERN)]

    def address(self) -> tuple[str, int]:
        """Return host and port of the control port."""
        host, _, port = self.control.rpartition(":")
        return host.strip("[]"), int(port)


class BenchDescription(_Part, frozen=True, kw_only=True):
    """One station, as its bench file describes it, defaults filled in; a role that the station has not is None."""

    name: Name
    title: Text = "a bench"
    visa_library: Text = "@py"
    power: PowerRole | None = None
    rate_source: FunctionGeneratorRole | None = None
    multimeter: MultimeterRole | None = None
    oscilloscope: OscilloscopeRole | None = None
    rate_table: RateTableRole | None = None
    vibration_source: FunctionGeneratorRole | None = None
    v_vc_meter: MultimeterRole | None = None
    chamber: ChamberRole | None = None
    wiring: Wiring = field(default_factory=Wiring)
    limits: Limits = field(default_factory=Limits)
    site: Site
    procedure_table: dict[str, Any] = field(default_factory=dict, name="procedure")
    """``[procedure]`` as it stands in the bench file: settings of all procedures, and a table for each that has some
    of its own; :mod:`vcfbench.procedures.layers` makes settings of it."""

    expected: Expected = field(default_factory=Expected)
    acceptance: Acceptance = field(default_factory=Acceptance)
    simulation: Simulation | None = None
    served: Served | None = None

    @property
    def procedure(self) -> ProcedureSettings:
        """What ``[procedure]`` says to every procedure, defaults filled in."""
        from vcfbench.procedures.layers import shared_settings  # noqa: PLC0415  # it needs what stands above

        return shared_settings(self)

    @property
    def simulated(self) -> bool:
        """Tell whether the bench is simulated, in this process or in another."""
        return self.simulation is not None or self.served is not None
