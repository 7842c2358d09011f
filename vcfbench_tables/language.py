"""Keys of a profile, a table language in TOML: frozen strict structs.

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

    gap_s: Pause = 0.0  # least time between two messages, s
    tx_end: str = "\r\n"  # end of sent lines
    rx_end: Annotated[str, Meta(min_length=1)] = "\r\n"  # end of received lines; CR, LF or both takes any of them
    echo: Literal["none", "optional", "always"] = "none"  # whether the table repeats what it gets
    prompt: str | None = None  # line that follows each reply


class Units(_Part, frozen=True, kw_only=True):
    """The table's units, sign and resolution; quanta and bounds are in the table's units."""

    rate: Literal["deg/s", "deg/min", "rpm", "counts/s"] = "deg/s"  # unit of rates
    counts_per_deg: _Positive = 1.0  # counts per degree, for `counts/s`
    velocity_factor: _Positive = 1.0  # own factor of rates
    acceleration_factor: _Positive = 1.0  # own factor of accelerations
    sign: Literal[1, -1] = 1  # -1 if clockwise, seen from above, is positive
    rate_quantum: _Positive  # step of rates, as sent: times the factors; they are rounded to it
    rate_min: _NotNegative = 0.0  # smallest rate, as sent
    rate_max: _Positive  # largest rate, as sent: 100000 is 100 deg/s where `velocity_factor` is 1000
    acceleration_quantum: _Positive | None = None  # step of accelerations, as sent; they are rounded down
    acceleration_min: _NotNegative = 0.0  # smallest acceleration, as sent
    acceleration_max: _Positive = math.inf  # largest acceleration, as sent
    positive: str = "0"  # `{dir}` of a positive rate
    negative: str = "1"  # `{dir}` of a negative rate
    travel: tuple[_Number, _Number] | None = None  # ends of travel, deg; `goto` turns it back from one
    axes: Annotated[tuple[int, ...], Meta(min_length=1)] = (1,)  # existing axes, as `axis` of the bench file, 1 to 6
    first_axis: Literal[0, 1] = 1  # 0: the table counts from 0, `{axis}` is one less; `rate_1`, `on_1`, groups are not

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

    send: str | None = None  # text as `V{rate:.3f}`, or bytes as `{axis:u8} 0C {rate:i32*1e5}`
    expect: _Name | None = None  # a name of `[replies]`
    timeout_s: _Seconds | None = None  # longest time of the step, s
    retry: Annotated[int, Meta(ge=0, le=5)] = 0  # queries only: repetitions
    repeat: _Times = 1  # stop commands and queries only: how often it is sent
    delay_s: Pause = 0.0  # pause after it, s
    optional_reply: bool = False  # the reply may be missing
    no_reply: bool = False  # no reply at all, not even the prompt
    until: _Name | None = None  # flag of `[status]` to wait for
    resend_s: _Seconds | None = None  # interval of sending while it waits, s


class Byte(_Part, frozen=True, kw_only=True):
    """A byte that a reply must have."""

    at: Place  # place of the byte
    value: ByteValue = field(name="is")  # its value


class Reply(_Part, frozen=True, kw_only=True):
    """Form of a reply: a regular expression for the whole line, or bytes. A late one may come at any time."""

    pattern: str | None = None  # regular expression for the whole line
    bytes: tuple[Byte, ...] = ()  # bytes that it must have, `[{ at = 2, is = 0x55 }]`
    split: Annotated[str, Meta(min_length=1, max_length=1)] | None = None  # character that separates items
    late: bool = False  # it may come at any time


class Refusals(_Part, frozen=True, kw_only=True):
    """Form of refusals: a line, bytes, or a question after each command whose good answer is known."""

    pattern: str | None = None  # regular expression of a refusal
    bytes: tuple[Byte, ...] = ()  # bytes of a refusal
    query: str | None = None  # query after each command
    good: str = "0"  # its answer if all is well
    deepest: Annotated[int, Meta(ge=1, le=100)] = 10  # most queries until it is good


class Stream(_Part, frozen=True, kw_only=True):
    """Status that comes unasked."""

    reply: _Name  # a name of `[replies]`
    max_age_s: _Seconds = 1.0  # oldest status that counts, s


class Field(_Part, frozen=True, kw_only=True):
    """A number in the last reply of a command, or in the stream; or the slope of another number."""

    source: _Name | None = field(name="from", default=None)  # a query, whose last reply has it, or `stream`
    at: Place | None = None  # place in the bytes
    type: BinaryType | TextType = "decimal"  # type of bytes; of text `decimal` or `hex`
    group: _Name | None = None  # group of the pattern; `{axis}` in it is our axis
    item: Place | None = None  # item of a split line
    scale: _Number = 1.0  # factor
    offset: _Number = 0.0  # added after it
    wrap: Wrap = "continuous"  # wrapping of an angle
    differentiate: _Name | None = None  # a field; this one is its slope
    span_s: _Seconds = 0.25  # time of the slope, s


class Flag(_Part, frozen=True, kw_only=True):
    """Yes or no in a reply: one bit, several, a value among some, a piece of text, or a bound; `negate` turns it round.

    Of several bits `mask` says which, `value` what they must be together: all of them 1 where it is not said.
    """

    source: _Name = field(name="from")  # a query, whose last reply has it, or `stream`
    at: Place | None = None  # place in the bytes
    bit: Annotated[int, Meta(ge=0, le=31)] | None = None  # bit that is the flag
    mask: Annotated[int, Meta(ge=1, le=0xFFFF_FFFF)] | None = None  # several bits
    value: Annotated[int, Meta(ge=0, le=0xFFFF_FFFF)] | None = None  # required content of the mask; without it all 1
    type: BinaryType | TextType = "u8"  # type of bytes; of text `decimal` or `hex`
    group: _Name | None = None  # group of the pattern
    item: Place | None = None  # item of a split line
    among: tuple[float, ...] | None = field(name="in", default=None)  # numbers that set it
    contains: str | None = None  # text that sets it
    above: float | None = None  # it is set above this
    below: float | None = None  # it is set below this
    negate: bool = False  # reversed


class Requirement(_Part, frozen=True, kw_only=True):
    """Requirement of a command: a flag; where it is not set, `by` is sent and the flag waited for."""

    flag: _Name  # must hold before the command
    by: _Name | None = None  # command that sets the flag
    within_s: _Seconds = 8.0  # time for that, s
    resend_s: _Seconds = 0.5  # interval of repeated sending, s


class AtRate(_Part, frozen=True, kw_only=True):
    """Substitute for an at-rate flag: so many readings in a row within a tolerance."""

    tolerance_deg_s: _Positive = 0.02  # tolerance of a reading, deg/s
    relative: _NotNegative = 1e-4  # relative part of it
    polls: Annotated[int, Meta(ge=1, le=100)] = 3  # readings in a row


class Safety(_Part, frozen=True, kw_only=True):
    """Limits of this table, its stop and shutdown commands, and the meaning of silence."""

    max_rate_deg_s: _Positive = math.inf  # limit of the rate, deg/s
    max_acceleration_deg_s2: _Positive = math.inf  # limit of the acceleration, deg/s²
    stop: tuple[_Name, ...] = ("stop",)  # commands that stop
    close: tuple[_Name, ...] = ("disable", "power_off")  # commands that switch off
    poll_s: _Seconds = 0.1  # interval of queries, s
    on_silence: Literal["fail", "stop"] = "fail"  # raise at once, or send `stop` before that


class Profile(_Part, frozen=True, kw_only=True):
    """A table language. `twin` names the simulated table that replaces it on a simulated bench."""

    title: _Name  # name of the table
    evidence: str  # source of the profile
    maker: str = ""  # maker of the table
    twin: str | None = None  # simulated table, `acl` or your own
    link: ProfileLink = field(default_factory=ProfileLink)  # the serial line
    frame: Frame = field(default_factory=Frame)  # form of messages
    reply_frame: Frame | None = None  # form of replies, if it differs
    units: Units  # units and axes
    commands: dict[str, tuple[Step, ...]]  # steps of each command
    replies: dict[str, Reply] = field(default_factory=dict)  # forms of replies
    refusals: Refusals = field(default_factory=Refusals)  # forms of refusals
    stream: Stream | None = None  # status that comes unasked
    fields: dict[str, Field]  # numbers in replies; `position` is required
    status: dict[str, Flag] = field(default_factory=dict)  # flags in replies
    requires: dict[str, Requirement] = field(default_factory=dict)  # requirements of commands
    at_rate: AtRate = field(default_factory=AtRate)  # if there is no flag `at_rate`
    safety: Safety = field(default_factory=Safety)  # limits, stop and silence

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
