"""The Digital Calibration Certificate of a voltmeter, read: its corrections and U of direct voltage by range and level.

What is read is the XML of PTB's schema, DCC 3.x with D-SI: https://ptb.de/dcc/v3.3.0/, and the refTypes of its good
practice (``basic_...``): a table is a ``dcc:list`` of quantities, or quantities that stand side by side. What is not
known is refused by its name, for a sign or a unit that is guessed would be counted as if it had been measured.
"""

import math
import re
from collections.abc import Iterator, Sequence
from datetime import date
from pathlib import Path
from typing import Final, NamedTuple
from xml.etree import ElementTree as ET

from msgspec import Struct, ValidationError, structs

from vcfbench.errors import ConfigError
from vcfbench.files import read_text, shown
from vcfbench.station.description import MultimeterRole
from vcfbench.station.parts import CalibrationPoint
from vcfbench.strict import refusal
from vcfbench.typed import typed

_NAMES: Final = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
_MOST: Final = 1 << 25
"""Bytes: a certificate may hold pictures and the printed one."""

_ROLES: Final = {
    "basic_referenceValue": "level",
    "basic_nominalValue": "nominal",
    "basic_measuredValue": "reading",
    "basic_measurementError": "error",
    "basic_measurementError_error": "error",
    "basic_measurementError_correction": "correction",
    "basic_measurementRange": "range",
    "basic_measurementRangeMax": "range",
    "basic_measurementRangeMin": "",
    "basic_acceptanceLimitLower": "",
    "basic_acceptanceLimitUpper": "",
}
"""Kind of a column by its refType; the other known ones are not needed."""

_RANGE_NAMES: Final = frozenset({"range", "measuring range", "measurement range", "messbereich", "bereich"})
"""By which a column of ranges is known that has no refType: the good practice has none for it everywhere."""

_DIRECT: Final = re.compile(r"(?:\b|_)dc(?!c)|direct|gleichspannung", re.IGNORECASE)
_ALTERNATING: Final = re.compile(r"(?:\b|_)ac(?:v|\b|_)|alternating|wechselspannung", re.IGNORECASE)
_CORRECTION: Final = re.compile(r"corre|korre", re.IGNORECASE)
_BEFORE: Final = re.compile(r"beforeAdjustment|before adjustment|as found|vor (der )?justage", re.IGNORECASE)

_RESULTS: Final = "dcc:measurementResults/dcc:measurementResult/dcc:results/dcc:result"
_IN_A_VOLT: Final = {"": 1.0, "nano": 1e9, "micro": 1e6, "milli": 1e3, "kilo": 1e-3}
"""Divisors: 10 by 1e6 is the float of 1e-5, 10 times 1e-6 is not."""
_VOLT: Final = re.compile(r"(?:\\(?P<prefix>nano|micro|milli|kilo))?\\volt")

_STATED: Final = (
    ("measurementUncertaintyUnivariateXMLList/expandedMUXMLList", "valueExpandedMUXMLList", "coverageFactorXMLList"),
    ("expandedUncXMLList", "uncertaintyXMLList", "coverageFactorXMLList"),
    ("measurementUncertaintyUnivariate/expandedMU", "valueExpandedMU", "coverageFactor"),
    ("expandedUnc", "uncertainty", "coverageFactor"),
    ("measurementUncertaintyUnivariateXMLList/standardMUXMLList", "valueStandardMUXMLList", ""),
    ("measurementUncertaintyUnivariate/standardMU", "valueStandardMU", ""),
)
"""Places of an uncertainty and its factor; a standard one has none: D-SI 2.2 and before, of a list and of one value."""

_OVER_RANGE: Final = 1.25
"""A meter's range measures so much of itself at most."""


class MeterCertificate(Struct, frozen=True):
    """Contents of a voltmeter's certificate: its number, the calibration's last day, the instrument, its points.

    `numbers` are those by which the instrument is known, with the party that gave each.
    """

    number: str
    calibrated: date
    model: str
    numbers: tuple[tuple[str, str], ...]
    points: tuple[CalibrationPoint, ...]

    def said(self) -> str:
        """Name the instrument."""
        numbers = ", ".join(f"{number} ({issuer})" for issuer, number in self.numbers)
        return f"{self.model or 'an instrument'} {numbers or 'without a number'}"


def read_meter_dcc(path: Path) -> MeterCertificate:
    """Return the values of direct voltage in a certificate's file.

    Raises:
        ConfigError: it is no such certificate, or holds something that is missing or not understood.
    """
    text = read_text(path, "a calibration certificate (DCC, XML)", _MOST)
    where = shown(path)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:  # entities could make any text of any size
        raise ConfigError(f"{where}: expected a DCC without DOCTYPE and entities: the schema has none")
    try:
        root = ET.fromstring(text.encode())  # noqa: S314  # it has no entities, and its size is bounded
    except (ET.ParseError, LookupError, ValueError) as error:
        raise ConfigError(f"{where}: expected XML in UTF-8: {error}") from None
    try:
        return _certificate(root)
    except _NotUnderstoodError as error:
        raise ConfigError(f"{where}: {error}") from None
    except RecursionError:
        raise ConfigError(f"{where}: expected a DCC, its lists are nested too deeply") from None


class _NotUnderstoodError(Exception):
    """Something missing in a certificate, or not understood."""


class _Column(NamedTuple):
    """A quantity of a table: name, values, U and k (one for all or one each), V."""

    name: str
    values: Sequence[float]
    expanded: Sequence[float]
    k: Sequence[float]


class _Table(NamedTuple):
    """Quantities side by side: name of the table, words around it, its own quantities, those around."""

    name: str
    words: str
    own: Sequence[ET.Element]
    around: Sequence[ET.Element]


def _certificate(root: ET.Element) -> MeterCertificate:
    if root.tag != f"{{{_NAMES['dcc']}}}digitalCalibrationCertificate":
        raise _NotUnderstoodError(f"expected a DCC, a dcc:digitalCalibrationCertificate, got {root.tag[:80]}")
    version = root.get("schemaVersion", "none")
    if not version.startswith("3."):
        raise _NotUnderstoodError(f"expected schemaVersion 3.x, got {version}")
    core, item = "dcc:administrativeData/dcc:coreData", "dcc:administrativeData/dcc:items/dcc:item"
    software = root.findall("dcc:administrativeData/dcc:dccSoftware/dcc:software/dcc:name/dcc:content", _NAMES)
    if "vcfbench" in map(_text, software):
        raise _NotUnderstoodError("expected the certificate of a voltmeter, got one of a gyroscope by vcfbench")
    number = _text(root.find(f"{core}/dcc:uniqueIdentifier", _NAMES))
    ended = _text(root.find(f"{core}/dcc:endPerformanceDate", _NAMES))
    if not number:
        raise _NotUnderstoodError("it has no number (dcc:uniqueIdentifier)")
    try:
        calibrated = date.fromisoformat(ended[:10])
    except ValueError:
        raise _NotUnderstoodError(f"expected a day as dcc:endPerformanceDate, got {ended or 'nothing'}") from None
    known = root.findall(f"{item}/dcc:identifications/dcc:identification", _NAMES)
    numbers = [(_text(each.find("dcc:issuer", _NAMES)), _text(each.find("dcc:value", _NAMES))) for each in known]
    model = _text(root.find(f"{item}/dcc:model", _NAMES))
    return MeterCertificate(number, calibrated, model, tuple(numbers), tuple(_points(root)))


def _points(root: ET.Element) -> Iterator[CalibrationPoint]:
    """Yield the points of all tables of direct voltage, each once."""
    seen: dict[tuple[float, float], CalibrationPoint] = {}
    for table in _tables(root):
        for point in _points_of(table):
            at = point.range_v, point.level_v
            if seen.setdefault(at, point) != point:
                said = f"{at[1]:g} V on the {at[0]:g} V range stand twice and differ (before and after an adjustment?)"
                raise _NotUnderstoodError(f"{table.name}: {said}")
    if not seen and any(_BEFORE.search(_words(each)) for each in root.findall(_RESULTS, _NAMES)):
        raise _NotUnderstoodError("its tables are as found, before an adjustment; expected those as left")
    if not seen:
        raise _NotUnderstoodError("it has no table of direct voltage, in volts, with refTypes of the good practice")
    yield from seen.values()


def _tables(root: ET.Element) -> Iterator[_Table]:
    """Yield the tables of direct voltage; those of an adjusted meter before its adjustment are left out."""
    for result in root.findall(_RESULTS, _NAMES):
        words = _words(result)
        if _BEFORE.search(words):
            continue
        for data in result.findall("dcc:data", _NAMES):
            for table in filter(_of_direct_voltage, _within(data, words, _name(result), ())):
                _require_conformity(table.name, result)
                yield table


def _require_conformity(name: str, result: ET.Element) -> None:
    """See that the laboratory does not say of a result that the meter, as it left, fails."""
    for said in map(_text, result.iter(f"{{{_NAMES['dcc']}}}conformity")):
        if said in {"fail", "conditionalFail", "nopass"}:
            raise _NotUnderstoodError(
                f"{name}: conformity {said}; expected a meter that passes as left: have it adjusted"
            )


def _within(element: ET.Element, words: str, name: str, around: Sequence[ET.Element]) -> Iterator[_Table]:
    own = element.findall("dcc:quantity", _NAMES)
    if {_role(each) for each in own} & {"level", "nominal", "reading", "error", "correction"}:
        yield _Table(name, " ".join([words, *map(_words, own)]), own, around)
    for each in element.findall("dcc:list", _NAMES):
        if not _BEFORE.search(_words(each)):
            yield from _within(each, f"{words} {_words(each)}", _name(each) or name, [*around, *own])


def _of_direct_voltage(table: _Table) -> bool:
    """Return True if it is one of direct voltage; in volts it has to say so."""
    levels = [column for column in table.own if _role(column) in {"level", "nominal", "reading"}]
    if not any(_in_volts(each) for level in levels for each in _numbers(level)):
        return False
    units = [_unit(each) for column in (*table.around, *table.own) for each in _numbers(column)]
    if any("hertz" in unit for unit in units) or _ALTERNATING.search(table.words):
        return False
    if not _DIRECT.search(table.words):
        raise _NotUnderstoodError(f"{table.name}: neither direct (DC) nor alternating voltage (AC) by name or refType")
    return True


def _columns(table: _Table) -> dict[str, _Column]:
    """Return the columns of a table by their kind."""
    columns: dict[str, _Column] = {}
    for quantity in table.own:
        unknown = [kind for kind in _kinds(quantity) if kind.startswith("basic_") and kind not in _ROLES]
        if unknown:
            raise _NotUnderstoodError(f"{table.name}, {_name(quantity)}: refType {unknown[0]} is not known here")
        if role := _role(quantity):
            if role in columns:
                raise _NotUnderstoodError(f"{table.name}: two quantities are marked as {role}; one is allowed")
            columns[role] = _column(table, quantity)
    return columns


def _points_of(table: _Table) -> Iterator[CalibrationPoint]:
    columns = _columns(table)
    ranges = columns.get("range")
    if ranges is None:
        around = next((each for each in reversed(table.around) if _role(each) == "range"), None)
        if around is None:
            raise _NotUnderstoodError(f"{table.name}: no range (a quantity basic_measurementRange, or one named Range)")
        ranges = _column(table, around)
    count = max(len(each.values) for each in columns.values())
    levels, corrections, stated = _levels_and_corrections(table, columns, count)
    if not stated.expanded:
        raise _NotUnderstoodError(f"{table.name}: no U of its {stated.name}")
    rows = (ranges.values, levels, corrections, stated.expanded, stated.k)
    for range_v, level_v, correction_v, expanded_v, k in zip(*(_each(table, row, count) for row in rows), strict=True):
        if not expanded_v > 0.0:
            raise _NotUnderstoodError(f"{table.name}: U of {expanded_v:g} V at {level_v:g} V")
        if abs(level_v) > _OVER_RANGE * range_v:
            raise _NotUnderstoodError(f"{table.name}: {level_v:g} V is not on a range of {range_v:g} V")
        values = {"range_v": range_v, "level_v": level_v, "correction_v": correction_v}
        try:
            yield typed({**values, "expanded_v": expanded_v, "k": k}, CalibrationPoint)
        except ValidationError as error:
            raise _NotUnderstoodError(f"{table.name}, {level_v:g} V: {error}") from None


def _levels_and_corrections(
    table: _Table, columns: dict[str, _Column], count: int
) -> tuple[Sequence[float], Sequence[float], _Column]:
    """Return the levels, the corrections to be added to a reading there, V, and the column that states their U.

    An error is the reading less the level; where both are there too, they must say the same.
    """
    reading, error, correction = (columns.get(role) for role in ("reading", "error", "correction"))
    level = columns.get("level") or columns.get("nominal")
    if level is None:
        raise _NotUnderstoodError(f"{table.name}: no level (basic_referenceValue or basic_nominalValue)")
    levels = _each(table, level.values, count)
    given = error or correction
    if given is None:
        if reading is None or "level" not in columns:
            raise _NotUnderstoodError(f"{table.name}: no basic_measurementError, nor reading and reference value")
        readings = _each(table, reading.values, count)
        return levels, [at - read for at, read in zip(levels, readings, strict=True)], reading
    sign = 1.0 if error is None else -1.0
    added = [sign * each for each in _each(table, given.values, count)]
    stated = reading if reading is not None and reading.expanded and not given.expanded else given
    if reading is not None and "level" in columns:
        room = [0.5 * each for each in _each(table, stated.expanded or (0.0,), count)]
        pairs = zip(levels, _each(table, reading.values, count), added, room, strict=True)
        if any(abs(at - read - by) > near + 1e-9 * abs(at) for at, read, by, near in pairs):
            raise _NotUnderstoodError(f"{table.name}: its {given.name} contradicts its reading and reference value")
    elif error is not None and _CORRECTION.search(error.name):
        raise _NotUnderstoodError(f"{table.name}: refType is an error, its name {error.name}; the sign is ambiguous")
    return levels, added, stated


def _each(table: _Table, values: Sequence[float], count: int) -> Sequence[float]:
    """Return so many values: one stands for all."""
    if len(values) == 1:
        return list(values) * count
    if len(values) != count:
        raise _NotUnderstoodError(f"{table.name}: expected {count} values in each list, got {len(values)}")
    return values


def _role(quantity: ET.Element) -> str:
    """Return the kind of a column; empty for one that is not needed."""
    roles = [_ROLES[kind] for kind in _kinds(quantity) if kind in _ROLES]
    if roles:
        return roles[0]
    return "range" if any(name.lower() in _RANGE_NAMES for name in _names(quantity)) else ""


def _kinds(quantity: ET.Element) -> list[str]:
    return quantity.get("refType", "").split()


def _column(table: _Table, quantity: ET.Element) -> _Column:
    """Return a column in volts."""
    name = _name(quantity) or quantity.get("refType", "")
    here = f"{table.name}, {name}"
    found = next(filter(_in_volts, _numbers(quantity)), None)
    if found is None:
        said = ", ".join(filter(None, map(_unit, _numbers(quantity))))
        raise _NotUnderstoodError(f"{here}: expected a number or a list of them in \\volt, got {said or 'none'}")
    units = map(_VOLT.fullmatch, _unit(found).split())
    scales = [_IN_A_VOLT[(unit and unit["prefix"]) or ""] for unit in units]
    values = _floats(here, _text(found.find("si:value", _NAMES)) or _text(found.find("si:valueXMLList", _NAMES)))
    if len(set(scales)) != 1:
        raise _NotUnderstoodError(f"{here}: expected one unit, got {_unit(found)}")
    expanded, k = _uncertainty(here, found)
    scale = scales[0]
    return _Column(name, [each / scale for each in values], [each / scale for each in expanded], k)


def _uncertainty(here: str, numbers: ET.Element) -> tuple[Sequence[float], Sequence[float]]:
    """Return U and k in the unit of the numbers; none where no uncertainty is stated."""
    for path, value, factor in _STATED:
        found = numbers.find("/".join(f"si:{each}" for each in path.split("/")), _NAMES)
        if found is not None:
            k = _floats(f"{here}, {factor}", _text(found.find(f"si:{factor}", _NAMES))) if factor else [1.0]
            return _floats(f"{here}, {value}", _text(found.find(f"si:{value}", _NAMES))), k
    for each in numbers:
        kind = each.tag.partition("}")[2]
        if "overage" in kind or "ncertainty" in kind:
            inner = next((below.tag.partition("}")[2] for below in each), kind)
            raise _NotUnderstoodError(f"{here}: an uncertainty as si:{inner} is not known here")
    return [], [1.0]


def _floats(here: str, text: str) -> list[float]:
    try:
        values = [float(each) for each in text.split()]
    except ValueError:
        raise _NotUnderstoodError(f"{here}: expected numbers, got {text[:40]}") from None
    if not values or not all(map(math.isfinite, values)):
        raise _NotUnderstoodError(f"{here}: expected numbers, got {text[:40] or 'nothing'}")
    return values


def _numbers(quantity: ET.Element) -> Iterator[ET.Element]:
    """Yield the elements with the numbers of a quantity: one in several units is a si:hybrid of them."""
    for inside in ("", "si:hybrid/"):
        for kind in ("si:real", "si:realListXMLList"):
            yield from quantity.findall(inside + kind, _NAMES)


def _in_volts(numbers: ET.Element) -> bool:
    units = _unit(numbers).split()
    return bool(units) and all(map(_VOLT.fullmatch, units))


def _unit(numbers: ET.Element) -> str:
    return _text(numbers.find("si:unit", _NAMES)) or _text(numbers.find("si:unitXMLList", _NAMES))


def _text(element: ET.Element | None) -> str:
    return "" if element is None or element.text is None else " ".join(element.text.split())


def _names(element: ET.Element) -> list[str]:
    return [_text(each) for each in element.findall("dcc:name/dcc:content", _NAMES)]


def _name(element: ET.Element) -> str:
    """Return the name of an element, in English where it has one."""
    named = element.findall("dcc:name/dcc:content", _NAMES)
    english = [_text(each) for each in named if each.get("lang") == "en"]
    return next(iter((*english, *map(_text, named))), "") or element.get("refType", "")


def _words(element: ET.Element) -> str:
    return " ".join((element.get("refType", ""), *_names(element)))


def with_certificate(part: MultimeterRole, role: str, source: str, folder: Path) -> MultimeterRole:
    """Return a meter with the points, the number and the day of the certificate that it names, found from `folder`.

    Raises:
        ConfigError: the file is not understood, is of another instrument, or contradicts what stands beside it.
    """
    found = read_meter_dcc(folder / str(part.calibration_dcc))
    where = f"{source}: {role}"
    if part.calibration:
        raise refusal(f"{where}.calibration", "no such table with calibration_dcc, which has it", "one more")
    _require_same(found, part, where)
    beside = (("certificate", part.certificate, found.number), ("calibrated", part.calibrated, found.calibrated))
    for key, stated, own in beside:
        if stated is not None and stated != own:
            raise refusal(f"{where}.{key}", f"{own}, as calibration_dcc has it, or nothing", str(stated))
    return structs.replace(
        part, calibration=found.points, certificate=found.number, calibrated=found.calibrated, calibration_dcc=None
    )


def _require_same(found: MeterCertificate, part: MultimeterRole, where: str) -> None:
    """See that the certificate is that of the instrument: by its model, and by each number that both tell."""
    models = [_bare(each) for each in (part.model, part.like) if each is not None]
    if found.model and not any(each in _bare(found.model) or _bare(found.model) in each for each in models):
        raise refusal(f"{where}.calibration_dcc", f"the certificate of a {part.model}", f"one of {found.said()}")
    serial = None if part.serial_number == "0" else part.serial_number
    numbers = {"serial_number": serial, "inventory_number": part.inventory_number}
    stated = {key: each for key, each in numbers.items() if each is not None}
    if not stated:
        expected = f"the number of the instrument as its certificate has it: {found.said()}"
        raise refusal(f"{where}.inventory_number (or serial_number)", expected, "nothing")
    known = {_bare(number) for _, number in found.numbers}
    by_maker = any(issuer == "manufacturer" for issuer, _ in found.numbers)
    matched = [_bare(each) in known for each in stated.values()]
    if not any(matched) or (serial is not None and by_maker and _bare(serial) not in known):
        said = " and ".join(f"{key} {each}" for key, each in stated.items())
        raise refusal(f"{where}.calibration_dcc", f"the certificate of {said}", f"one of {found.said()}")


def _bare(text: str) -> str:
    """Return letters and digits alone: spaces and dashes are written as one likes."""
    return "".join(filter(str.isalnum, text)).lower()
