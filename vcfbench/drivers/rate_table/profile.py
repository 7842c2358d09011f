"""A table language told in TOML: frozen strict structs, and every mistake in one line.

A profile says what goes over the wire; :class:`~vcfbench.drivers.rate_table.configurable.ConfigurableDialect` does it.
"""

from __future__ import annotations

import math
import re
import warnings
from importlib import resources
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import Meta, Struct, field

from vcfbench.drivers.rate_table import templates
from vcfbench.drivers.rate_table.checksums import CHECKSUMS
from vcfbench.drivers.rate_table.fields import BinaryType, TextType, Wrap  # noqa: TC001 - msgspec reads them
from vcfbench.drivers.rate_table.frames import ByteValue, Frame, Place, frame_bytes, frame_text
from vcfbench.drivers.rate_table.line import Link, Pause
from vcfbench.errors import ConfigError
from vcfbench.files import parse_toml, read_text, shown
from vcfbench.models import find_language
from vcfbench.typed import typed

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


QUESTIONS = ("identify", "home_status", "read_pos", "read_rate", "read_all", "status", "fault")
"""Commands that only ask: they may be asked again."""
COMMANDS = (
    *QUESTIONS,
    *("remote", "local", "power_on", "power_off", "clear_fault", "enable", "disable", "home", "set_accel"),
    *("load_rate", "start", "goto", "stop", "estop"),
)

_ALWAYS_KNOWN = frozenset({"axis", "seq", *(f"on_{slot}" for slot in range(1, 7))})
"""Names that a template of stopping a table may use."""

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
    link: Link = field(default_factory=Link)
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
        """Tell whether messages are bytes and not lines."""
        return self.frame.kind != "line"

    @property
    def received_frame(self) -> Frame:
        """The frame of replies, which is that of messages unless it is said to differ."""
        return self.reply_frame or self.frame


def _comes_along(name: str) -> bool:
    """Tell whether `name` is a language whose profile comes with the package."""
    row = find_language(name)
    return row is not None and row.dialect is None


def load_profile(name: str) -> Profile:
    """Return the shipped profile `name`, or that of the file of this name.

    Raises:
        ConfigError: there is none, or it is not one; the message is one line with file, key and what was expected.
    """
    return parse_profile(profile_text(name), f"profile {name}" if _comes_along(name) else shown(name))


def profile_text(name: str) -> str:
    """Return the text of the shipped profile `name`, or of the file of this name; ConfigError if it cannot be read."""
    if _comes_along(name):
        return resources.files("vcfbench.drivers.rate_table").joinpath(f"profiles/{name}.toml").read_text("utf-8")
    return read_text(name, "a profile of a rate table")


def parse_profile(text: str, source: str) -> Profile:
    """Return the profile that the TOML `text` tells; `source` names it in errors (ConfigError)."""
    raw = parse_toml(text, source)
    # Try the entries under names of the profile's choice one by one: msgspec's path would not tell the name
    for section, kind in _KEYED.items():
        if isinstance(raw.get(section), dict):
            for name, value in raw[section].items():
                _convert(value, kind, (section, name), source)
    profile = _convert(raw, Profile, (), source)
    for path, expected, came in _invalid_values(profile):
        raise _error(source, path, expected, came)
    return profile


# Errors

_T = TypeVar("_T")
_AT = re.compile(r" - at `\$(?P<path>[^`]*)`$")
_STEP = re.compile(r"\.([^.\[]+)|\[(\d+)\]")
_KEYED: dict[str, Any] = {
    "commands": tuple[Step, ...],
    "replies": Reply,
    "fields": Field,
    "status": Flag,
    "requires": Requirement,
}


def _convert(raw: Any, kind: type[_T], path: tuple[str, ...], source: str) -> _T:
    try:
        return typed(raw, kind)
    except msgspec.ValidationError as error:
        raise _explained(str(error), raw, path, source) from None


def _explained(message: str, raw: Any, path: tuple[str, ...], source: str) -> ConfigError:
    found = _AT.search(message)
    what = message[: found.start()] if found else message
    keys = [key or int(index) for key, index in _STEP.findall(found["path"])] if found else []
    value = raw
    for key in keys:
        value = value[key]
    dotted = _dotted((*path, *keys))
    if missing := re.fullmatch(r"Object missing required field `(.*)`", what):
        return _error(source, f"{dotted}.{missing[1]}".removeprefix("."), "a value", "nothing")
    if unknown := re.fullmatch(r"Object contains unknown field `(.*)`", what):
        return _error(source, f"{dotted}.{unknown[1]}".removeprefix("."), "a known key", "an unknown key")
    expected = what.removeprefix("Expected ").partition(", got ")[0].replace("`", "")
    return _error(source, dotted, " ".join(_WORDS.get(word, word) for word in expected.split()), value)


_WORDS = {
    "float": "a number",
    "int": "a whole number",
    "str": "a text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
    ">=": "at least",
    "<=": "at most",
    ">": "above",
    "<": "below",
}


def _dotted(keys: tuple[str | int, ...]) -> str:
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys).removeprefix(".")


def _error(source: str, path: str, expected: str, came: object) -> ConfigError:
    text = came if came in ("nothing", "an unknown key") else repr(came)
    shown = text if len(str(text)) <= 60 else f"{str(text)[:57]}..."
    return ConfigError(f"{source}: {path}: expected {expected}, came {shown}")


# What the types cannot say

_InvalidValue = tuple[str, str, object]


def _invalid_values(profile: Profile) -> Iterator[_InvalidValue]:
    yield from _invalid_texts(profile)
    yield from _invalid_frames("frame", profile.frame)
    if profile.reply_frame is not None:
        yield from _invalid_frames("reply_frame", profile.reply_frame)
        if (profile.reply_frame.kind == "line") is profile.binary:
            expected = "line where messages are lines, and not where they are bytes"
            yield "reply_frame.kind", expected, profile.reply_frame.kind
    yield from _invalid_replys(profile)
    for name, steps in profile.commands.items():
        if name not in COMMANDS:
            yield f"commands.{name}", f"one of {', '.join(COMMANDS)}", "an unknown key"
        for number, step in enumerate(steps):
            yield from _invalid_steps(f"commands.{name}[{number}]", name, step, profile)
    for name in ("stop", "start"):
        if not profile.commands.get(name):
            yield f"commands.{name}", "at least one step", "nothing"
    if not any(profile.commands.get(name) for name in ("identify", "read_all", "read_pos")) and profile.stream is None:
        yield "commands.identify", "a question that a table answers, or [stream]", "nothing"
    yield from _invalid_fields(profile)
    yield from _invalid_flags(profile)
    yield from _invalid_circles(profile)
    yield from _invalid_safetys(profile)


def _invalid_texts(profile: Profile) -> Iterator[_InvalidValue]:
    """Yield the texts that no line can carry: else they would be found when the table is to be stopped."""
    texts = {
        "frame.start": profile.frame.start,
        "frame.checksum_mark": profile.frame.checksum_mark,
        "link.tx_end": profile.link.tx_end,
        "link.rx_end": profile.link.rx_end,
        "link.prompt": profile.link.prompt or "",
        "refusals.query": profile.refusals.query or "",
    }
    for path, text in texts.items():
        if not text.isascii():
            yield path, "ASCII characters alone", text


def _invalid_frames(path: str, frame: Frame) -> Iterator[_InvalidValue]:
    if frame.kind != "line" and not frame.header:
        yield f"{path}.header", "hexadecimal bytes", frame.header
    if frame.kind == "fixed" and frame.length is None:
        yield f"{path}.length", "the length of a frame", "nothing"
    if frame.kind == "length_field" and frame.length_at is None:
        yield f"{path}.length_at", "the place of the length", "nothing"
    if frame.kind == "delimited" and not frame.trailer:
        yield f"{path}.trailer", "hexadecimal bytes", frame.trailer
    if frame.kind == "line" and frame.checksum is not None and not frame.checksum.endswith("_hex"):
        names = ", ".join(name for name in CHECKSUMS if name.endswith("_hex"))
        yield f"{path}.checksum", f"for lines one of {names}", frame.checksum


def _invalid_replys(profile: Profile) -> Iterator[_InvalidValue]:
    patterns = {f"replies.{name}.pattern": reply.pattern for name, reply in profile.replies.items()}
    patterns |= {"refusals.pattern": profile.refusals.pattern, "refusals.good": profile.refusals.good}
    for path, pattern in patterns.items():
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", FutureWarning)  # what may mean something else to a later Python
                re.compile(pattern or "")
        except (re.error, FutureWarning, OverflowError, RecursionError) as error:
            yield path, f"a regular expression ({error})", pattern
    for name, reply in profile.replies.items():
        if (reply.pattern is None) is not profile.binary or (bool(reply.bytes) and not profile.binary):
            yield f"replies.{name}", "bytes where messages are bytes, a pattern where they are lines", reply.pattern
    if profile.stream is not None and profile.stream.reply not in profile.replies:
        yield "stream.reply", "one of [replies]", profile.stream.reply


def _invalid_steps(path: str, name: str, step: Step, profile: Profile) -> Iterator[_InvalidValue]:
    if step.retry and name not in QUESTIONS:
        yield f"{path}.retry", f"0: only questions are asked again ({', '.join(QUESTIONS)})", step.retry
    if step.repeat > 1 and name not in ("stop", "estop", *QUESTIONS):
        yield f"{path}.repeat", "1: only stopping is repeated blindly", step.repeat
    if step.expect is not None and step.expect not in profile.replies:
        yield f"{path}.expect", "one of [replies]", step.expect
    if step.expect is not None and step.no_reply:
        yield f"{path}.no_reply", "false where a reply is expected", step.no_reply
    if step.until is not None and step.until not in profile.status:
        yield f"{path}.until", "one of [status]", step.until
    try:
        _try_template(step.send or "", profile, templates.sample_values())
    except ValueError as error:
        yield f"{path}.send", f"a template ({error})", step.send


def _try_template(template: str, profile: Profile, values: Mapping[str, templates.Value]) -> None:
    if profile.binary:
        frame_bytes(profile.frame, templates.fill_bytes(template, values, profile.frame.order))
    else:
        frame_text(profile.frame, templates.fill_text(template, values), profile.link.tx_end)


def _sources(profile: Profile) -> set[str]:
    return {name for name, steps in profile.commands.items() if steps and name in QUESTIONS} | (
        {STREAM} if profile.stream is not None else set()
    )


def _invalid_fields(profile: Profile) -> Iterator[_InvalidValue]:
    if "position" not in profile.fields:
        yield "fields.position", "a field", "nothing"
    known = _sources(profile)
    for name, each in profile.fields.items():
        path = f"fields.{name}"
        if each.differentiate is not None:
            other = profile.fields.get(each.differentiate)
            if other is None or other.differentiate is not None:
                yield f"{path}.differentiate", "a field that is read", each.differentiate
        elif each.source not in known:
            yield f"{path}.from", f"one of {', '.join(sorted(known))}", each.source
        else:
            yield from _invalid_places(path, each, profile)
    rate, position = profile.fields.get("rate"), profile.fields.get("position")
    if rate is not None and rate.differentiate is None and rate == position:
        yield "fields.rate", "another number than the position", f"{rate.source}, {rate.group or rate.item or rate.at}"


def _invalid_places(path: str, each: Field | Flag, profile: Profile) -> Iterator[_InvalidValue]:
    if profile.binary and each.at is None:
        yield f"{path}.at", "the place of the first byte", "nothing"
    if profile.binary and each.type in ("decimal", "hex"):
        yield f"{path}.type", "a type of bytes", each.type
    if not profile.binary and each.group is None and each.item is None:
        yield f"{path}.group", "a named group of the reply's pattern, or an item", "nothing"
    if not profile.binary and each.group is not None and not _is_group(each.group, profile, each.source):
        yield f"{path}.group", "a named group of the reply's pattern", each.group
    if not profile.binary and isinstance(each, Field) and each.type not in ("decimal", "hex"):
        yield f"{path}.type", "decimal or hex", each.type


def _is_group(group: str, profile: Profile, source: str | None) -> bool:
    """Tell whether a reply that `source` brings has the group, of some axis."""
    wanted = re.escape(group).replace(r"\{axis\}", r"\w+")
    brought = {each.expect for each in profile.commands.get(source or "", ())}
    if source == STREAM and profile.stream is not None:
        brought = {profile.stream.reply}
    patterns = [reply.pattern or "" for name, reply in profile.replies.items() if name in brought]
    return any(re.search(rf"\(\?P<{wanted}>", pattern) for pattern in patterns)


def _invalid_flags(profile: Profile) -> Iterator[_InvalidValue]:
    known = _sources(profile)
    for name, flag in profile.status.items():
        path = f"status.{name}"
        if flag.source not in known:
            yield f"{path}.from", f"one of {', '.join(sorted(known))}", flag.source
        if [flag.bit, flag.mask, flag.among, flag.contains, flag.above, flag.below].count(None) == 6:
            yield path, "one of bit, mask, in, contains, above, below", "nothing"
        if flag.value is not None and flag.value & ~(flag.mask or 0):
            yield f"{path}.value", f"bits of mask, {flag.mask or 0:#x}", f"{flag.value:#x}"
        yield from _invalid_places(path, flag, profile)
    for name, need in profile.requires.items():
        if name not in profile.commands:
            yield f"requires.{name}", "one of [commands]", "an unknown key"
        if need.flag not in profile.status:
            yield f"requires.{name}.flag", "one of [status]", need.flag
        if need.by is not None and need.by not in profile.commands:
            yield f"requires.{name}.by", "one of [commands]", need.by


def _invalid_circles(profile: Profile) -> Iterator[_InvalidValue]:
    """Find commands that need themselves, straight or by way of others: such a table would be asked for ever."""
    done: set[str] = set()

    def walk(name: str, way: tuple[str, ...]) -> Iterator[_InvalidValue]:
        for path, came, needed in _needs(name, profile):
            if needed in (*way, name):
                circle = " -> ".join((*way, name, needed)[(*way, name).index(needed) :])
                yield path, f"what does not need {name} itself ({circle})", came
            elif needed not in done:
                yield from walk(needed, (*way, name))
        done.add(name)

    for name in profile.commands:
        if name not in done:
            yield from walk(name, ())


def _needs(name: str, profile: Profile) -> Iterator[tuple[str, str, str]]:
    """Yield the commands that are sent for a command: the key that asks for it, its value, the command."""

    def read(path: str, flag: str) -> Iterator[tuple[str, str, str]]:
        if flag in profile.status and profile.status[flag].source in profile.commands:
            yield path, flag, profile.status[flag].source

    for number, step in enumerate(profile.commands[name]):
        if step.until is not None:
            yield from read(f"commands.{name}[{number}].until", step.until)
    need = profile.requires.get(name)
    if need is not None:
        yield from read(f"requires.{name}.flag", need.flag)
        if need.by in profile.commands:
            yield f"requires.{name}.by", str(need.by), str(need.by)


def _invalid_safetys(profile: Profile) -> Iterator[_InvalidValue]:
    for name in profile.safety.stop:
        if name not in profile.commands:
            yield "safety.stop", "names of [commands]", name
    # See that the table can be told to stop whatever is known of it: these words are sent before all else
    known = {name: value for name, value in templates.sample_values().items() if name in _ALWAYS_KNOWN}
    steps = [step for name in profile.safety.stop for step in profile.commands.get(name, ()) if step.send is not None]
    if not steps:
        yield "safety.stop", "commands that send something", list(profile.safety.stop)
    for step in steps:
        try:
            _try_template(step.send or "", profile, known)
        except ValueError as error:
            yield "safety.stop", f"commands that need no rate, acceleration or position ({error})", step.send
    units = profile.units
    if units.rate_quantum > units.rate_max:
        yield "units.rate_quantum", f"at most rate_max, {units.rate_max:g}", units.rate_quantum
    if units.rate_min > units.rate_max:
        yield "units.rate_min", f"at most rate_max, {units.rate_max:g}", units.rate_min
    if units.acceleration_min > units.acceleration_max:
        yield "units.acceleration_min", f"at most acceleration_max, {units.acceleration_max:g}", units.acceleration_min
