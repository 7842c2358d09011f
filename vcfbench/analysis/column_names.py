"""Names of columns as people write them, with their units: ``rate / (deg/s)``, ``gyro_z [mdps]``, ``output_mv``.

The unit is the longest end of a name that is one, so that the s of ``wz_mrad_s`` is no second. What stands in brackets
and is no unit that is known is kept as `unknown`: nobody may take the column for something.
"""

import re
import unicodedata
from collections.abc import Iterator, Sequence
from enum import Enum
from math import degrees
from shlex import quote

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.errors import ConfigError


class Kind(Enum):
    """Quantity that a unit measures, with the unit that it is converted to."""

    RATE = "deg/s"
    VOLTAGE = "V"
    COUNT = "LSB"
    TIME = "s"
    TEMPERATURE = "degC"
    OTHER = ""
    """A unit that is known, of nothing that is analysed: an angle, a current, an acceleration."""


class Unit(Struct, frozen=True):
    """A unit as written, and what makes the unit of its kind of a number: a factor, then `added`."""

    written: str
    kind: Kind
    factor: float
    added: float = 0.0


class ColumnName(Struct, frozen=True):
    """A name of a column, taken apart."""

    written: str
    base: str
    """The name without unit and without what marks an uncertainty, lower case."""
    unit: Unit | None = None
    unknown: str = ""
    """Words in brackets that are no known unit."""
    spread: str = ""
    """``u`` of a standard uncertainty, ``std`` of a standard deviation of readings."""

    @property
    def kind(self) -> Kind | None:
        """Quantity of the column; None without a unit, or for an uncertainty."""
        return None if self.unit is None or self.spread else self.unit.kind

    @property
    def is_time(self) -> bool:
        """Return True if the column has the times of the readings, by its name."""
        alone = not self.base and self.unit is not None  # a column that is called seconds
        return not self.spread and self.kind in {None, Kind.TIME} and (alone or _names_a_time(self.base))


KNOWN = "deg/s, deg/h, rad/s, dps, mdps, mrad/s, rpm, V, mV, uV, LSB, counts"
"""Units of what can be analysed, in the words of errors."""

_PREFIXES = {"": 1.0, "k": 1e3, "m": 1e-3, "u": 1e-6, "\u03bc": 1e-6, "n": 1e-9}
_SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millis", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "\u03bcs", "usec", "micros", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanos", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86400.0),
}
_ANGLES = {
    **dict.fromkeys(("deg", "degree", "degrees", "\u00b0"), 1.0),
    **dict.fromkeys(("rad", "radian", "radians"), degrees(1.0)),
    **dict.fromkeys(("arcsec", "arcsecond", "arcseconds"), 1.0 / 3600.0),
    **dict.fromkeys(("rev", "turn", "turns"), 360.0),
    "gon": 0.9,
}
_SHORT_RATES = {"dps": 1.0, "dph": 1.0 / 3600.0, "rpm": 6.0}
_COUNTS = {"lsb", "lsbs", "count", "counts", "cts", "digit", "digits", "raw", "adc"}
_COUNTERS = {
    *("error", "errors", "clip", "loop", "sample", "samples", "packet", "frame", "line", "row", "drop", "dropped"),
    *("step", "message", "msg", "cycle", "retry", "lost", "missed", "reading", "readings", "device"),
}
"""Words before a count that is no output."""
_OTHERS = {
    *("g", "mg", "ug", "m/s2", "m/s^2", "m_s2", "m/s**2", "ms-2", "a", "ma", "ua", "hz", "khz", "pa", "hpa", "kpa"),
    *("mbar", "bar", "%", "rh", "%rh", "ohm", "kohm", "t", "mt", "ut", "gauss", "mgauss", "w", "mw", "m", "mm"),
}
_TEMPERATURES = {
    **dict.fromkeys(
        (
            "degc",
            "\u00b0c",
            "c",
            "deg_c",
            "deg c",
            "degree c",
            "degrees c",
            "celsius",
            "degree celsius",
            "degrees celsius",
            "grad c",
            "grad celsius",
        ),
        (1.0, 0.0),
    ),
    **dict.fromkeys(("mdegc", "m\u00b0c", "millicelsius"), (1e-3, 0.0)),
    **dict.fromkeys(("k", "kelvin"), (1.0, -273.15)),
    **dict.fromkeys(("mk", "millikelvin"), (1e-3, -273.15)),
    **dict.fromkeys(("degf", "\u00b0f", "f", "deg_f", "deg f", "fahrenheit"), (5.0 / 9.0, -160.0 / 9.0)),
    **dict.fromkeys(("degr", "\u00b0r", "rankine"), (5.0 / 9.0, -273.15)),
}
_KINDS = {
    **dict.fromkeys(_OTHERS, Kind.OTHER),
    **dict.fromkeys(_COUNTS, Kind.COUNT),
    **dict.fromkeys(_TEMPERATURES, Kind.TEMPERATURE),
    **dict.fromkeys(_SECONDS, Kind.TIME),
}
_OUTPUTS = {Kind.RATE, Kind.VOLTAGE, Kind.COUNT}
_SCALED = {Kind.RATE, Kind.VOLTAGE, Kind.TIME, Kind.TEMPERATURE}
_WHOLE_ANGLE = re.compile(rf"([kmun\u03bc]?)({'|'.join(_ANGLES)})")
_RATE = re.compile(
    rf"([kmun\u03bc]?)({'|'.join(_ANGLES)})(?: ?/ ?|[_ ]?per[_ ]?|_)({'|'.join(_SECONDS)})"
    rf"|([kmun\u03bc]?)({'|'.join(_ANGLES)})[ .*_\u00b7\u22c5]?({'|'.join(_SECONDS)}) ?\^?\*{{0,2}}\(?-1\)?"
)
_SHORT_RATE = re.compile(rf"([kmun\u03bc]?)({'|'.join(_SHORT_RATES)})")
_VOLT = re.compile(r"([kmun\u03bc]?)(?:v|volt|volts)(?:[ _]?dc)?")
_FACTOR = re.compile(
    r"(?:(10\^[+-]?\d+|10-\d+)|(\d*\.?\d+e[+-]?\d+|0?\.\d+))\s*[*x\u00b7\u00d7]?\s*([^\W\d].*|\u00b0.*)", re.IGNORECASE
)
"""A factor before a unit that is no range: one that is below 1, or has an exponent."""
_TIMES = re.compile(r"(.*[^\s*x\u00d7_])[\s_]*[*x\u00d7][\s_]*(10{1,6})", re.IGNORECASE)
_COUNTED_END = re.compile(r"\b(?:lsbs?|counts|cts)\b", re.IGNORECASE)
_TIME_WORDS = {
    *(
        "t",
        "time",
        "times",
        "timestamp",
        "timestamps",
        "datetime",
        "date",
        "elapsed",
        "stamp",
        "uptime",
        "clock",
        "epoch",
        "ts",
        "tick",
        "ticks",
        "utc",
    ),
    *("zeit", "uhrzeit", "zeitstempel", "temps", "tiempo", "tempo", "seconds", "secs", "millis", "micros"),
}
_SPREADS = {"u": "u", "unc": "u", "uncertainty": "u", "std": "std", "sd": "std", "stdev": "std", "sigma": "std"}
_BRACKETS = re.compile(r"[\[({<]([^\[\](){}<>]*(?:\([^()]*\))?[^\[\](){}<>]*)[\])}>]")
_GOES_ON = re.compile(r"[/^*\u00b7]")
"""What makes another unit of the one before it."""
_CLOSING = re.compile(r"[\])}>]\s*$")
_SPLIT = re.compile(r"\s*/\s*|\s+in\s+|[\s_,]+")
_WORD = re.compile(r"[^\W_]+")
_SPREAD = re.compile(r"^(u|unc|uncertainty|std|sd|stdev|sigma)(?:[_ ]|\s*\((?=[^()]*\)))", re.IGNORECASE)
_SPREAD_END = re.compile(r"[_ ](std|sd|stdev|unc)$")


def unit_of(written: str) -> Unit | None:
    """Return the unit that some words are, None if they are none that is known.

    The case of letters counts in a prefix alone: a capital M is no milli.
    """
    text = unicodedata.normalize("NFKC", written.replace("\u00ba", "\u00b0")).replace("\u2212", "-").strip()
    text = text.removeprefix("(").removesuffix(")").strip() if text.startswith("(") and text.endswith(")") else text
    text = text.replace("\u00b5", "\u03bc")
    low = text[:1] + text[1:].lower() if text[:1] == "M" else text.lower()
    if found := _RATE.fullmatch(low):
        prefix, angle, time = (found[1], found[2], found[3]) if found[2] else (found[4], found[5], found[6])
        return Unit(written, Kind.RATE, _PREFIXES[prefix] * _ANGLES[angle] / _SECONDS[time])
    if found := _SHORT_RATE.fullmatch(low):
        return Unit(written, Kind.RATE, _PREFIXES[found[1]] * _SHORT_RATES[found[2]])
    if found := _VOLT.fullmatch(low):
        return Unit(written, Kind.VOLTAGE, _PREFIXES[found[1]])
    if (found := _FACTOR.fullmatch(text)) and (unit := unit_of(found[3])) and unit.kind in _SCALED:
        power = float(found[2] or f"1e{found[1][2:].removeprefix('^')}")
        return Unit(written, unit.kind, power * unit.factor, unit.added)
    kind = _KINDS.get(low, Kind.OTHER if _WHOLE_ANGLE.fullmatch(low) else None)
    return None if kind is None else Unit(written, kind, *_TEMPERATURES.get(low, (_SECONDS.get(low, 1.0), 0.0)))


def of_unknown_size(name: str) -> str:
    """Return the end of a name that is one unit over another, or has an M of milli or mega; "" without such an end."""
    for end in (name, *(end for _, end in _ends(name))):
        over, _, under = end.rpartition("/")
        milli = unit_of(end.lower()) if end[:1] == "M" else None
        if (unit_of(over) and unit_of(under)) or (milli and milli.kind in {Kind.RATE, Kind.VOLTAGE}):
            return end
    return ""


def cure_of(unknown: str, column: str) -> str | None:
    """Return the option for a unit that may mean one of two, None where nothing is known to propose."""
    if unknown.strip().lower() in {"rps", "rads"}:
        return f"--unit {quote(f'{column}=rev/s')}, or rad/s"
    if (found := _TIMES.fullmatch(unknown)) and unit_of(found[1]):
        power = len(found[2]) - 1
        small, large = (quote(f"{column}=1e{sign}{power} {found[1]}") for sign in ("-", ""))
        return f"--unit {small} if numbers were multiplied, {large} if they count so much"
    return None


def known_unit(written: str, where: str) -> Unit:
    """Return the unit of a given name; raises ConfigError for an unknown one."""
    if (unit := unit_of(written)) is None:
        raise ConfigError(f"{where}: expected a unit of {KNOWN}, s, ms, us, ns, min, h, d, degC, got {written!r}")
    return unit


def with_unit(name: ColumnName, written: str) -> ColumnName:
    """Return a name with the unit that a person says it has; raises ConfigError for one that is not known."""
    unit = known_unit(written, f"--unit {name.written}={written}")
    return replace(name, unit=unit, unknown="")


def column_name(written: str, *, spreads: bool = True) -> ColumnName:
    """Take the name of a column apart; without `spreads` it is none of an uncertainty."""
    found = _taken_apart(written, spreads=spreads)
    return found if spreads or not found.spread else replace(found, spread="")


def _taken_apart(written: str, *, spreads: bool) -> ColumnName:
    text, spread = written.strip(), ""
    if spreads and (found := _SPREAD.search(text)):
        spread, text = _SPREADS[found[1].lower()], text[found.end() :]
        if found[0].rstrip().endswith("("):  # u(output) [V]
            text = text.replace(")", "", 1)
    groups = list(_BRACKETS.finditer(text))
    if several := _contradicting(text, groups):
        return _named(written, text[: groups[0].start()], spread, None, several)
    for group in reversed(groups):
        if (unit := unit_of(group[1])) is not None and not _GOES_ON.search(text, group.end()):
            base = f"{text[: group.start()]} {text[group.end() :]}"
            return _named(written, base.rstrip().removesuffix("/"), spread, unit)
    if (unit := unit_of(text)) is not None and unit.kind in (Kind.RATE, Kind.TIME, Kind.COUNT) and len(text) > 1:
        return ColumnName(written, "", unit, spread=spread)
    for base, end in _ends(text):
        is_over = (column_name(base).unit or unit_of(base)) is not None
        ratio = is_over and text[len(base) : len(text) - len(end)].strip() == "/"
        if (unit := unit_of(end)) is not None and _may_be(unit, base) and not ratio:  # mV/V is no V
            return _named(written, base, spread, unit)
    if groups and _CLOSING.search(text):
        return _named(written, text[: groups[-1].start()], spread, None, groups[-1][1].strip() or " ")
    over = re.search(r"\S\s+/\s+(.+)$", text) or re.search(r"\S\s*/\s*(\(.+\))$", text)
    unknown = over[1] if over else of_unknown_size(text)
    return _named(written, text[: over.start() + 1] if over else text, spread, None, unknown)


def _contradicting(text: str, groups: Sequence[re.Match[str]]) -> str:
    """Return the units of a name that has several of different kinds, in words."""
    kinds = {unit.kind: unit.written for group in groups if (unit := unit_of(group[1])) and unit.kind in _OUTPUTS}
    if kinds and (counted := _COUNTED_END.search(_BRACKETS.sub(" ", text))):
        kinds[Kind.COUNT] = counted[0]
    return " and ".join(kinds.values()) if len(kinds) > 1 else ""


def _ends(text: str) -> Iterator[tuple[str, str]]:
    """Yield every way to split a name in two, that with the longest end first."""
    for found in _SPLIT.finditer(text):
        if found.start() > 0:
            yield text[: found.start()], text[found.end() :]


def _may_be(unit: Unit, base: str) -> bool:
    """Return True if an end without brackets is meant as a unit: an s, h or c may be part of a name or another one."""
    if unit.kind is Kind.TIME:
        return _names_a_time(base)
    if unit.kind is Kind.TEMPERATURE:
        return "temp" in base.lower() or len(unit.written) > 1
    if unit.kind is Kind.COUNT and _COUNTERS & set(_WORD.findall(base.lower())):
        return False
    return len(unit.written) > 1 or unit.kind is Kind.VOLTAGE


def _named(written: str, base: str, spread: str, unit: Unit | None, unknown: str = "") -> ColumnName:
    plain = " ".join(base.lower().split()).strip(" _-/,")
    if not spread and (found := _SPREAD_END.search(plain)):
        plain, spread = plain[: found.start()], _SPREADS[found[1]]
    return ColumnName(written, plain, unit, unknown, spread)


def _names_a_time(base: str) -> bool:
    return bool(_TIME_WORDS & set(_WORD.findall(base.lower())))
