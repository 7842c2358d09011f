"""Settings of the DSO7104B; their defaults are the default setup."""

from __future__ import annotations

from msgspec import Struct, field

from simrack.scpi import Settings

CHANNELS = (1, 2, 3, 4)


class ChannelSettings(Struct):
    """One channel."""

    range_v: float = 40.0
    offset_v: float = 0.0
    coupling: str = "DC"
    impedance: str = "ONEM"
    bandwidth_limit: bool = False
    inverted: bool = False
    unit: str = "VOLT"
    probe: float = 1.0
    skew_s: float = 0.0
    probe_type: str = "SING"
    vernier: bool = False
    protection: str = "NORM"
    shown: bool = False
    label: str = ""


class Timebase(Struct):
    """Time base, main and delayed window."""

    mode: str = "MAIN"
    range_s: float = 0.001
    position_s: float = 0.0
    reference: str = "CENT"
    vernier: bool = False
    window_position_s: float = 0.0
    window_range_s: float = 0.0001


class Acquiring(Struct):
    """Acquisition of records: type, count, segments."""

    type: str = "NORM"
    mode: str = "RTIM"
    count: int = 8
    complete_percent: int = 100
    segments: int = 2
    segment: int = 1


class EdgeTrigger(Struct):
    """Edge trigger, and settings common to all triggers."""

    mode: str = "EDGE"
    sweep: str = "AUTO"
    source: str = "CHAN1"
    slope: str = "POS"
    coupling: str = "DC"
    reject_hf: bool = False
    reject_noise: bool = False
    holdoff_s: float = 6e-08


class PulseTrigger(Struct):
    """The pulse width trigger; its times after *RST are unverified."""

    source: str = "CHAN1"
    qualifier: str = "LESS"
    polarity: str = "POS"
    less_s: float = 3e-08
    range_s: tuple[float, float] = (3e-08, 1e-08)
    greater_s: float = 2e-08


class TelevisionTrigger(Struct):
    """The television trigger."""

    source: str = "CHAN1"
    mode: str = "ALIN"
    standard: str = "NTSC"
    polarity: str = "NEG"
    line: int = 1


class Measuring(Struct):
    """Sources, thresholds and statistics of measurements."""

    sources: tuple[str, str] = ("CHAN1", "NONE")
    thresholds: tuple[str, float, float, float] = ("STAN", 90.0, 50.0, 10.0)
    delay_edges: tuple[int, int] = (1, 1)
    statistics: str = "ON"
    shown: bool = False


class MathFunction(Struct):
    """The math function; None follows sources and time base until it is set."""

    shown: bool = False
    operation: str = "ADD"
    range: float | None = None
    offset: float | None = None
    window: str = "HANN"
    centre_hz: float | None = None
    span_hz: float | None = None
    goft_operation: str = "ADD"
    source: dict[int, str] = field(default_factory=lambda: {1: "CHAN1", 2: "CHAN2"})
    goft_source: dict[int, str] = field(default_factory=lambda: {1: "CHAN1", 2: "CHAN2"})


class WaveformOutput(Struct):
    """Form in which records are sent."""

    source: str = "CHAN1"
    format: str = "BYTE"
    unsigned: bool = True
    byte_order: str = "MSBF"
    points: int = 1000
    points_mode: str = "NORM"
    view: str = "MAIN"


class Display(Struct):
    """The display."""

    vectors: bool = True
    labels: bool = False
    persistence: str = "MIN"
    memory: str = "PMEM0"


class HardCopy(Struct):
    """Hard copies."""

    area: str = "SCR"
    factors: bool = False
    form_feed: bool = False
    format: str = "PNG"
    ink_saver: bool = True
    layout: str = "PORT"
    palette: str = "NONE"


class ExternalInput(Struct):
    """The external trigger input."""

    bandwidth_limit: bool = False
    range_v: float = 8.0
    unit: str = "VOLT"
    probe: float = 1.0
    probe_type: str = "SING"


class Saving(Struct):
    """Files that are saved; the defaults are unverified."""

    name: str = ""
    folder: str = ""
    image_area: str = "GRAT"
    image_factors: bool = False
    image_format: str = "NONE"
    image_ink_saver: bool = True
    image_palette: str = "COL"
    waveform_format: str = "NONE"
    waveform_points: int = 1000


class Recalling(Struct):
    """Files that are recalled."""

    name: str = ""
    folder: str = ""


class ScopeSettings(Settings, forbid_unknown_fields=True):
    """Everything that is set."""

    channel: dict[int, ChannelSettings] = field(
        default_factory=lambda: {
            channel: ChannelSettings(shown=channel == 1, label=str(channel)) for channel in CHANNELS
        }
    )
    levels_v: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys((*(f"CHAN{channel}" for channel in CHANNELS), "EXT", "LINE"), 0.0)
    )
    timebase: Timebase = field(default_factory=Timebase)
    acquire: Acquiring = field(default_factory=Acquiring)
    trigger: EdgeTrigger = field(default_factory=EdgeTrigger)
    pulse: PulseTrigger = field(default_factory=PulseTrigger)
    television: TelevisionTrigger = field(default_factory=TelevisionTrigger)
    measure: Measuring = field(default_factory=Measuring)
    function: MathFunction = field(default_factory=MathFunction)
    waveform: WaveformOutput = field(default_factory=WaveformOutput)
    display: Display = field(default_factory=Display)
    hardcopy: HardCopy = field(default_factory=HardCopy)
    external: ExternalInput = field(default_factory=ExternalInput)
    save: Saving = field(default_factory=Saving)
    recall: Recalling = field(default_factory=Recalling)
    autoscale_channels: str = "ALL"
    locked: bool = False
    protection_locked: bool = False

    def channel_of(self, source: str) -> ChannelSettings:
        """Return the settings of the channel that is called `CHAN1`."""
        return self.channel[int(source[4:])]

    def is_shown(self, source: str) -> bool:
        """Return True if a channel or the math trace (`FUNC`) is on the screen."""
        return self.function.shown if source == "FUNC" else self.channel_of(source).shown

    def show(self, source: str, shown: bool) -> None:  # noqa: FBT001
        """Put a channel or the math trace on the screen, or take it off."""
        shows = self.function if source == "FUNC" else self.channel_of(source)
        shows.shown = shown
