"""A run as a Digital Calibration Certificate: the XML of PTB's schema, DCC 3.3.0 with D-SI 2.2.

Source: https://ptb.de/dcc/v3.3.0/ and https://ptb.de/si/v2.2.1/, the published schemas. What is written is not signed,
and is no certificate of an accredited laboratory unless a laboratory makes it one.
"""

import math
import re
from base64 import b64encode
from collections.abc import Iterator, Sequence
from decimal import ROUND_CEILING, Context, Decimal
from typing import Final
from xml.etree import ElementTree as ET

from vcfbench.archive.certificate import CertificateWords
from vcfbench.archive.days import days_of
from vcfbench.archive.output_unit import unit_of_record
from vcfbench.archive.reported import method_of
from vcfbench.archive.run import Run
from vcfbench.archive.si_units import in_si
from vcfbench.archive.unseen import unseen_of, unseen_words
from vcfbench.errors import ConfigError
from vcfbench.records.metadata import Equipment
from vcfbench.records.schema import Status
from vcfbench.reports.text import printable_lines
from vcfbench.reports.typography import in_unicode
from vcfbench.values.definition import Conditions
from vcfbench.values.printing import grouped, incomplete
from vcfbench.values.quantile import t_quantile
from vcfbench.values.value import Value

SCHEMA_VERSION: Final = "3.3.0"
_DCC: Final = "https://ptb.de/dcc"
_SI: Final = "https://ptb.de/si"
_XSI: Final = "http://www.w3.org/2001/XMLSchema-instance"
_COVERAGE: Final = "0.95"
_FACTOR: Final = t_quantile(0.05, math.inf)
"""Coverage factor of conditions, whose degrees of freedom nobody keeps."""
_UNSIGNED: Final = (
    "This file was written by a measuring program. It is not signed, and it is not the certificate of an accredited "
    "laboratory unless a laboratory checks it, completes it and makes it one."
)
_SIMULATED: Final = "SIMULATED: instruments and device were simulated. Nothing in this file was measured."
_NAMESPACE: Final = "vcf"
_REF_TYPES: Final = (
    ("basic", "terms of the DCC Wiki", "https://wiki.dcc.ptb.de/en/dccrefTypeDefinitions"),
    (_NAMESPACE, "names of results in vcfbench, in camel case", "vcfbench, docs/reports.md"),
)
_CONFORMITY: Final = {
    "pass": "pass",
    "fail": "fail",
    "conditional pass": "conditionalPass",
    "conditional fail": "conditionalFail",
}


def dcc_of(run: Run, words: CertificateWords, document: tuple[str, bytes] | None = None) -> bytes:
    """Return the certificate of `run` as XML in UTF-8, the same bytes for the same record, words and document.

    `document` is the name and bytes of the report for people (PDF), which it then holds.

    Values with an uncertainty become D-SI quantities with their expanded uncertainty for 95 % and its factor; those in
    a unit that D-SI has no words for stand as text, values without an uncertainty are left out.

    Raises:
        ConfigError: the run is not complete, or its results have no uncertainty.
    """
    if run.status is not Status.COMPLETE:
        raise ConfigError(f"run {run.name}: a certificate needs a run that is complete, this one is {run.status.value}")
    stated = run.values.values()
    values = [each for each in stated if each.u95 is not None or each.form != "plus-minus"]
    if not values:
        raise ConfigError(f"run {run.name}: a certificate needs results with uncertainties; these results have no U95")
    for prefix, space in (("dcc", _DCC), ("si", _SI), ("xsi", _XSI)):
        ET.register_namespace(prefix, space)
    root = ET.Element(f"{{{_DCC}}}digitalCalibrationCertificate", {"schemaVersion": SCHEMA_VERSION})
    root.set(f"{{{_XSI}}}schemaLocation", f"{_DCC} https://ptb.de/dcc/v{SCHEMA_VERSION}/dcc.xsd")
    _administrative(_under(root, "administrativeData"), run, words, values)
    _measured(_under(_under(root, "measurementResults"), "measurementResult"), run, values)
    if document is not None:
        held = _under(root, "document")
        for name, text in (("fileName", document[0]), ("mimeType", "application/pdf")):
            _under(held, name, text)
        _under(held, "dataBase64", b64encode(document[1]).decode())
    ET.indent(root)
    said = ET.tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n<!-- {_UNSIGNED} -->\n{said}\n'.encode()


def _under(parent: ET.Element, name: str, text: str | None = None, space: str = _DCC) -> ET.Element:
    """Add an element; of its text nothing is left that XML could not hold, or that is space alone."""
    element = ET.SubElement(parent, f"{{{space}}}{name}")
    if text is not None:
        element.text = " ".join(printable_lines(text).split()) or "-"
    return element


def _say(parent: ET.Element, name: str, *lines: str, german: str = "") -> ET.Element:
    """Add an element that holds words in English, and in German where those are known."""
    element = _under(parent, name)
    for line in lines:
        _under(element, "content", line).set("lang", "en")
    if german:
        _under(element, "content", german).set("lang", "de")
    return element


def _ref_type(name: str) -> str:
    """Return by what machines find a result: ``vcf_turntable vcf_scaleFactor`` for ``turntable.scale_factor``."""
    of = [re.sub(r"_+(\w)", lambda found: found[1].upper(), re.sub(r"\W", "_", each)) for each in name.split(".")]
    return " ".join(f"{_NAMESPACE}_{each}" for each in of)


def _administrative(parent: ET.Element, run: Run, words: CertificateWords, values: Sequence[Value]) -> None:
    software = _under(parent, "dccSoftware")
    for name, version in (run.header.get("versions") or {"vcfbench": "-"}).items():
        one = _under(software, "software")
        _say(one, "name", name)
        _under(one, "release", str(version))
    definitions = _under(parent, "refTypeDefinitions")
    for namespace, said, link in _REF_TYPES:
        one = _under(definitions, "refTypeDefinition")
        _say(one, "name", said)
        _under(one, "namespace", namespace)
        _under(one, "link", link)
    _core(_under(parent, "coreData"), run, words, german=any(each.named.german for each in values))
    item = _under(_under(parent, "items"), "item")
    _say(item, "name", words.item)
    if words.item_manufacturer:
        _say(_under(item, "manufacturer"), "name", words.item_manufacturer)
    if words.item_model:
        _under(item, "model", words.item_model)
    _identification(_under(item, "identifications"), "manufacturer", words.serial, "serial number")
    laboratory = _under(parent, "calibrationLaboratory")
    if words.laboratory_code:
        _under(laboratory, "calibrationLaboratoryCode", words.laboratory_code)
    contact = _under(laboratory, "contact")
    _contact(contact, words.laboratory, words.laboratory_email, words.laboratory_address, words.country)
    person = _under(_under(parent, "respPersons"), "respPerson")
    _say(_under(person, "person"), "name", words.responsible)
    if words.responsible_function:
        _under(person, "role", words.responsible_function)
    _under(person, "mainSigner", "true")
    _contact(_under(parent, "customer"), words.customer, words.customer_email, words.customer_address)
    statements = _under(parent, "statements")
    for each in _declarations(run, words, values):
        _say(_under(statements, "statement"), "declaration", each)
    if run.verdict is not None:
        one = _under(statements, "statement")
        one.set("refType", "basic_conformity")
        limits = [
            f"{run.verdict.named(each).words}, {each.key} from {each.low:g} to {each.high:g}: {each.stated}"
            for each in run.verdict.limits
        ]
        _say(one, "declaration", "Conformity with the limits of the bench file", *limits)
        _under(one, "conformity", _CONFORMITY[run.verdict.conditional or run.verdict.word])


def _declarations(run: Run, words: CertificateWords, values: Sequence[Value]) -> Iterator[str]:
    """Yield the declarations of a certificate besides its results."""
    yield _UNSIGNED
    if run.simulated:
        yield _SIMULATED
    if missing := dict.fromkeys(name for each in values for name in each.missing):
        yield f"INCOMPLETE: uncertainties are stated here without {', '.join(missing)}, of which nothing was known"
    for key in ("place", "received", "method", "deviations", "adjustment"):
        if text := getattr(words, key):
            yield f"{key}: {text}"
    yield from (f"not checked: {each}" for each in run.not_checked)
    for what, size, done in unseen_words(run, unseen_of(run)):
        yield f"not in U95, because not refused: {what}, {size}; it may have moved {done}"


def _core(parent: ET.Element, run: Run, words: CertificateWords, *, german: bool) -> None:
    began, ended = days_of(run) or ("", "")
    _under(parent, "countryCodeISO3166_1", words.country)
    for language in ("en", "de") if german else ("en",):
        _under(parent, "usedLangCodeISO639_1", language)
    _under(parent, "mandatoryLangCodeISO639_1", "en")
    _under(parent, "uniqueIdentifier", words.identifier)
    if run.name is not None:
        _identification(_under(parent, "identifications"), "calibrationLaboratory", run.name, "name of the record")
    _under(parent, "beginPerformanceDate", f"{began}Z")  # days of UTC: xs:date has its zone behind it
    _under(parent, "endPerformanceDate", f"{ended}Z")
    _under(parent, "performanceLocation", "laboratory")
    if words.issued:
        _under(parent, "issueDate", words.issued)


def _identification(parent: ET.Element, issuer: str, value: str, name: str) -> None:
    one = _under(parent, "identification")
    _under(one, "issuer", issuer)
    _under(one, "value", value)
    _say(one, "name", name)


def _contact(parent: ET.Element, name: str, email: str, address: str, country: str = "") -> None:
    _say(parent, "name", name)
    if email:
        _under(parent, "eMail", email)
    location = _under(parent, "location")
    if country:
        _under(location, "countryCode", country)
    _say(location, "further", address)


def _measured(parent: ET.Element, run: Run, values: Sequence[Value]) -> None:
    _say(parent, "name", in_unicode(str(run.header.get("title") or run.procedure)))
    method = _under(_under(parent, "usedMethods"), "usedMethod")
    _say(method, "name", run.procedure)
    _say(method, "description", in_unicode(method_of(run)))
    if run.equipment:
        equipment = _under(parent, "measuringEquipments")
        for each in run.equipment:
            _equipment(_under(equipment, "measuringEquipment"), each)
    influences = [*_influences(run, values[0].conditions if values else Conditions())]
    conditions = _under(parent, "influenceConditions") if influences else parent
    for name, ref_type, value, u, unit in influences:
        one = _under(conditions, "influenceCondition")
        one.set("refType", ref_type)
        _say(one, "name", name)
        _real(_under(_under(one, "data"), "quantity"), value, unit, None if u is None else _FACTOR * u, _FACTOR)
    results = _under(parent, "results")
    result = _under(results, "result")
    _say(result, "name", "values")
    data = _under(result, "data")
    for each_value in values:
        _quantity(data, each_value)
    if run.points:
        _points(_under(results, "result"), run)


def _influences(run: Run, held: Conditions) -> Iterator[tuple[str, str, float, float | None, str]]:
    """Yield what influences the values: name, refType, value, u (None: not stated), unit in D-SI."""
    room = run.metadata
    if room.ambient_temperature_c is not None:
        yield "temperature of the room", "basic_temperature", room.ambient_temperature_c, None, r"\degreecelsius"
    if room.humidity_percent is not None:
        yield "relative humidity", "basic_humidityRelative", room.humidity_percent, None, r"\percent"
    for sign, rail_v in zip(("positive", "negative"), held.rails_v or (), strict=False):
        if rail_v:  # one supply has no negative rail
            yield f"{sign} rail", _ref_type(f"{sign}_rail"), rail_v, None, r"\volt"
    if held.drive is not None:
        yield (
            "frequency of the drive",
            _ref_type("drive_frequency"),
            held.drive.frequency_hz,
            held.drive.u_hz,
            r"\hertz",
        )
        if held.drive.temperature_c is not None:
            at_c, u_k = held.drive.temperature_c, held.drive.u_temperature_k
            name = "temperature of the device, by the frequency of its drive"
            yield name, _ref_type("device_temperature"), at_c, u_k, r"\degreecelsius"


def _equipment(parent: ET.Element, each: Equipment) -> None:
    if each.certificate or each.calibrated:
        parent.set("refType", "basic_measurementStandard")
    _say(parent, "name", each.title)
    dates = (("calibrated", each.calibrated), ("calibration due", each.calibration_due))
    said = [f"{name}: {value}" for name, value in (*dates, ("certificate", each.certificate)) if value is not None]
    if each.overdue:
        said.append("the calibration was OVERDUE on the day of the run")
    if said:
        _say(parent, "description", *said)
    if each.identity is not None and each.identity.maker:
        _say(_under(parent, "manufacturer"), "name", each.identity.maker)
    _under(parent, "model", each.model)
    numbers = (("manufacturer", each.serial_number, "serial"), ("owner", each.inventory_number, "inventory"))
    if each.serial_number or each.inventory_number:
        identifications = _under(parent, "identifications")
        for issuer, number, name in numbers:
            if number:
                _identification(identifications, issuer, number, f"{name} number")


def _quantity(parent: ET.Element, value: Value) -> None:
    quantity = _under(parent, "quantity")
    quantity.set("refType", f"basic_measuredValue {_ref_type(value.name)}")
    of = value.named
    _say(quantity, "name", in_unicode(of.words), german=of.german)
    if said := (value.of + incomplete(value.missing)).removeprefix("; "):
        _say(quantity, "description", in_unicode(said))
    in_words = in_si(value.unit)
    if value.form != "plus-minus":
        _say(quantity, "noQuantity", f"{value.figure()} {value.unit} (95 %)")
        return
    if value.value is None or in_words is None:
        words = [f"{value.figure()} {value.unit}", *([] if value.u95 is None else [f"U95 {grouped(value.u95)}"])]
        words += [] if value.coverage_factor is None else [f"k {value.coverage_factor:.2f}"]
        _say(quantity, "noQuantity", ", ".join(words))
        return
    scale, unit = in_words
    # where u is 0 there is no factor
    u95 = None if value.u95 is None or value.coverage_factor is None else scale * value.u95
    _real(quantity, scale * value.value, unit, u95, value.coverage_factor or 0.0)


def _real(parent: ET.Element, value: float, unit: str, u95: float | None, factor: float) -> None:
    """Add a D-SI quantity with its expanded uncertainty, in three digits, up; the value has two places more."""
    real = _under(parent, "real", space=_SI)
    stated, expanded = f"{value:.10g}", None
    if u95:
        expanded = Context(prec=3, rounding=ROUND_CEILING).create_decimal(repr(u95))
        least = Decimal(1).scaleb(expanded.adjusted() - 4)
        stated = repr(float(Decimal(repr(value)).quantize(least)))
    _under(real, "value", stated, _SI)
    _under(real, "unit", unit, _SI)
    if expanded is not None:
        of_real = _under(_under(real, "measurementUncertaintyUnivariate", space=_SI), "expandedMU", space=_SI)
        _under(of_real, "valueExpandedMU", repr(float(expanded)), _SI)
        _under(of_real, "coverageFactor", f"{factor:.3f}", _SI)
        _under(of_real, "coverageProbability", _COVERAGE, _SI)


def _points(parent: ET.Element, run: Run) -> None:
    """Add the points as lists, step by step: their rates, V_Vc and the mean output."""
    _say(parent, "name", "points")
    _say(parent, "description", "means of the readings, in the order in which they were taken")
    output = in_si(unit_of_record(run.header)) or (1.0, r"\one")
    columns = {
        "step": ([float(point.step) for point in run.points], r"\one"),
        "rate": ([point.rate_deg_s for point in run.points], r"\degree\second\tothe{-1}"),
        "V_Vc": ([point.v_vc_v for point in run.points], r"\volt"),
        "output": ([point.output_v for point in run.points], output[1]),
    }
    table = _under(_under(parent, "data"), "list")
    for name, (values, unit) in columns.items():
        quantity = _under(table, "quantity")
        quantity.set("refType", _ref_type(name))
        _say(quantity, "name", name)
        numbers = _under(quantity, "realListXMLList", space=_SI)
        _under(numbers, "valueXMLList", " ".join(f"{each:.10g}" for each in values), _SI)
        _under(numbers, "unitXMLList", unit, _SI)
