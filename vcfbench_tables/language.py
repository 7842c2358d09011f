"""Keys of a profile, a table language told in TOML: frozen strict structs.

:mod:`~vcfbench_tables.profile` reads and checks one,
:class:`~vcfbench_tables.configurable.ConfigurableDialect` does what it says.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from vcfbench.drivers.serial_wire import Link, Pause
from vcfbench_tables import messages
from vcfbench_tables.messages import BinaryType, ByteValue, Frame, Place, TextType, Wrap

QUESTIONS = ("identify", "home_status", "read_pos", "read_rate", "read_all", "status", "fault")
"""Commands that only ask: they may be asked again."""
COMMANDS = (
    *QUESTIONS,
    *("remote", "local", "power_on", "power_off", "clear_fault", "enable", "disable", "home", "set_accel"),
    *("load_rate", "start", "goto", "stop", "estop"),
)

STREAM = "stream"
"""In place of a command: the status that comes unasked."""

_Name = Annotated[str, Meta(min_length=1, max_length=60)]
_Seconds = Annotated[float, Meta(gt=0.0, le=600.0)]
_Times = Annotated[int, Meta(ge=1, le=10)]
_Positive = Annotated[float, Meta(ge=1e-12, le=1e12)]
_NotNegative = Annotated[float, Meta(ge=0.0, le=1e12)]
_Number = Annotated[float, Meta(ge=-1e12, le=1e12)]
"""Beyond these no table counts: more than 64 bit of the finest encoder."""


class _Part(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of a profile: frozen, strict."""


class ProfileLink(Link, frozen=True, kw_only=True):
    """Set-up of the serial line, the gap between messages, and the ends of text lines."""

    gap_s: Pause = 0.0
    tx_end: str = "\r\n"
    rx_end: Annotated[str, Meta(min_length=1)] = "\r\n"
    echo: Literal["none", "optional", "always"] = "none"
    prompt: str | None = None


class Units(_Part, frozen=True, kw_only=True):
    """The table's units, sign and resolution; quanta and bounds are in the table's units."""

    rate: Literal["deg/s", "deg/min", "rpm", "counts/s"] = "deg/s"
    counts_per_deg: _Positive = 1.0
    velocity_factor: _Positive = 1.0
    acceleration_factor: _Positive = 1.0
    sign: Literal[1, -1] = 1
    rate_quantum: _Positive
    rate_min: _NotNegative = 0.0
    rate_max: _Positive
    acceleration_quantum: _Positive | None = None
    acceleration_min: _NotNegative = 0.0
    acceleration_max: _Positive = math.inf
    positive: str = "0"
    negative: str = "1"
    travel: tuple[_Number, _Number] | None = None
    axes: Annotated[tuple[int, ...], Meta(min_length=1)] = (1,)
    first_axis: Literal[0, 1] = 1

    @property
    def plain_per_deg(self) -> float:
        """Table's units to a degree, per second or per second squared, its own factors apart."""
        return {"deg/s": 1.0, "deg/min": 60.0, "rpm": 1.0 / 6.0, "counts/s": self.counts_per_deg}[self.rate]

    @property
    def rate_per_deg(self) -> float:
        """Table's units of rate to 1 deg/s."""
        return self.plain_per_deg * self.velocity_factor


class Step(_Part, frozen=True, kw_only=True):
    """One message of a command: its text, the expected reply, time-out, repeats, and the flag waited for."""

    send: str | None = None
    expect: _Name | None = None
    timeout_s: _Seconds | None = None
    retry: Annotated[int, Meta(ge=0, le=5)] = 0
    repeat: _Times = 1
    delay_s: Pause = 0.0
    optional_reply: bool = False
    no_reply: bool = False
    until: _Name | None = None
    resend_s: _Seconds | None = None


class Byte(_Part, frozen=True, kw_only=True):
    """A byte that a reply must have."""

    at: Place
    value: ByteValue = field(name="is")


class Reply(_Part, frozen=True, kw_only=True):
    """Form of a reply: a regular expression for the whole line, or bytes. A late one may come at any time."""

    pattern: str | None = None
    bytes: tuple[Byte, ...] = ()
    split: Annotated[str, Meta(min_length=1, max_length=1)] | None = None
    late: bool = False


class Refusals(_Part, frozen=True, kw_only=True):
    """Form of refusals: a line, bytes, or a question after each command whose good answer is known."""

    pattern: str | None = None
    bytes: tuple[Byte, ...] = ()
    query: str | None = None
    good: str = "0"
    deepest: Annotated[int, Meta(ge=1, le=100)] = 10


class Stream(_Part, frozen=True, kw_only=True):
    """Status that comes unasked."""

    reply: _Name
    max_age_s: _Seconds = 1.0


class Field(_Part, frozen=True, kw_only=True):
    """A number in the last reply of a command, or in the stream; or the slope of another number."""

    source: _Name | None = field(name="from", default=None)
    at: Place | None = None
    type: BinaryType | TextType = "decimal"
    group: _Name | None = None
    item: Place | None = None
    scale: _Number = 1.0
    offset: _Number = 0.0
    wrap: Wrap = "continuous"
    differentiate: _Name | None = None
    span_s: _Seconds = 0.25


class Flag(_Part, frozen=True, kw_only=True):
    """Yes or no in a reply: one bit, several, a value among some, a piece of text, or a bound; `negate` turns it round.

    Of several bits `mask` says which, `value` what they must be together: all of them 1 where it is not said.
    """

    source: _Name = field(name="from")
    at: Place | None = None
    bit: Annotated[int, Meta(ge=0, le=31)] | None = None
    mask: Annotated[int, Meta(ge=1, le=0xFFFF_FFFF)] | None = None
    value: Annotated[int, Meta(ge=0, le=0xFFFF_FFFF)] | None = None
    type: BinaryType | TextType = "u8"
    group: _Name | None = None
    item: Place | None = None
    among: tuple[float, ...] | None = field(name="in", default=None)
    contains: str | None = None
    above: float | None = None
    below: float | None = None
    negate: bool = False


class Requirement(_Part, frozen=True, kw_only=True):
    """Requirement of a command: a flag; where it is not set, `by` is sent and the flag waited for."""

    flag: _Name
    by: _Name | None = None
    within_s: _Seconds = 8.0
    resend_s: _Seconds = 0.5


class AtRate(_Part, frozen=True, kw_only=True):
    """Substitute for an at-rate flag: so many readings in a row within a tolerance."""

    tolerance_deg_s: _Positive = 0.02
    relative: _NotNegative = 1e-4
    polls: Annotated[int, Meta(ge=1, le=100)] = 3


class Safety(_Part, frozen=True, kw_only=True):
    """Limits of this table, its stop and shutdown commands, and the meaning of silence."""

    max_rate_deg_s: _Positive = math.inf
    max_acceleration_deg_s2: _Positive = math.inf
    stop: tuple[_Name, ...] = ("stop",)
    close: tuple[_Name, ...] = ("disable", "power_off")
    poll_s: _Seconds = 0.1
    on_silence: Literal["fail", "stop"] = "fail"


class Profile(_Part, frozen=True, kw_only=True):
    """A table language. `twin` names the simulated table that stands in for it on a simulated bench."""

    title: _Name
    evidence: str
    maker: str = ""
    twin: str | None = None
    link: ProfileLink = field(default_factory=ProfileLink)
    frame: Frame = field(default_factory=Frame)
    reply_frame: Frame | None = None
    units: Units
    commands: dict[str, tuple[Step, ...]]
    replies: dict[str, Reply] = field(default_factory=dict)
    refusals: Refusals = field(default_factory=Refusals)
    stream: Stream | None = None
    fields: dict[str, Field]
    status: dict[str, Flag] = field(default_factory=dict)
    requires: dict[str, Requirement] = field(default_factory=dict)
    at_rate: AtRate = field(default_factory=AtRate)
    safety: Safety = field(default_factory=Safety)

    @property
    def binary(self) -> bool:
        """Return True if messages are bytes and not lines."""
        return self.frame.kind != "line"

    @property
    def received_frame(self) -> Frame:
        """The frame of replies, which is that of messages unless it is said to differ."""
        return self.reply_frame or self.frame

    def message(self, template: str, values: Mapping[str, messages.Value]) -> bytes:
        """Return the bytes that a template comes to, framed; ValueError where it cannot be filled with `values`."""
        if self.binary:
            return messages.frame_bytes(self.frame, messages.fill_bytes(template, values, self.frame.order))
        return messages.frame_text(self.frame, messages.fill_text(template, values), self.link.tx_end)
