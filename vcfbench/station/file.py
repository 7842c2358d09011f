"""Reads bench files: TOML to a frozen description, every mistake one line with file, key path and expected value."""

from collections.abc import Callable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from vcfbench.drivers.rate_table.dialect import TableSettings, spoken
from vcfbench.errors import ConfigError
from vcfbench.files import dotted, parse_toml, read_text, shown
from vcfbench.station.consistency import invalid_values, shared_wires
from vcfbench.station.description import BenchDescription
from vcfbench.station.layering import merged
from vcfbench.station.stream_profiles import with_stream
from vcfbench.strict import converted, refusal, unknown_key, words

EMBEDDED = ("paper", "lab", "ideal")
"""Names of the benches that come with the package, usable in place of a file."""

Check = Callable[["BenchDescription", str], None]
"""A check of a floor above, of the part of a bench file that is its own; the text names the file in errors."""


def read_bench(path: Path | str | None = None, *checks: Check) -> BenchDescription:
    """Return the bench described by the file at `path`; None is the embedded paper bench.

    `checks` are those of floors above, which this one does not know; embedded benches are tested.
    The name of an embedded bench serves as a path where no such file exists; a directory of that name is no bench file.

    Raises:
        ConfigError: the file cannot be read, is not TOML, or does not describe a bench.
    """
    if path is None:
        return _embedded("paper")
    if not isinstance(path, Path | str):  # an int would be read as a descriptor: of a terminal, for ever
        raise ConfigError(f"bench: expected a bench file or one of {', '.join(EMBEDDED)}, got {path!r}")
    if str(path) in EMBEDDED and (not Path(path).exists() or Path(path).is_dir()):
        return _embedded(str(path))
    source, folder = shown(path), Path(path).parent
    values = parse_toml(read_text(path, "a bench file"), source)
    description = checked_bench(values, source, folder=folder)
    # the files that it names are found from where its own is; a profile is read
    notice, laboratory, table = description.notify, description.laboratory, description.rate_table
    if notice is not None and len(Path(notice.command[0]).parts) > 1:  # a program named by a path
        notice = replace(notice, command=(str((folder / notice.command[0]).absolute()), *notice.command[1:]))
    if laboratory.signing_key is not None:
        laboratory = replace(laboratory, signing_key=str((folder / laboratory.signing_key).absolute()))
    if table is not None and table.dialect.endswith(".toml"):
        table = replace(table, dialect=str(folder / table.dialect))
        spoken(table.dialect, TableSettings(axis=table.axis))
    description = replace(description, notify=notice, laboratory=laboratory, rate_table=table)
    for check in checks:
        check(description, source)
    return description


def described(bench: BenchDescription | Path | str | None, *checks: Check) -> BenchDescription:
    """Return the bench as a description, read with :func:`read_bench` where a file is named."""
    return bench if isinstance(bench, BenchDescription) else read_bench(bench, *checks)


def parse_bench(text: str, source: str, *checks: Check) -> BenchDescription:
    """Return the bench that the TOML `text` describes; `source` names it in errors (ConfigError).

    Files that it names are found from the folder of `source`.
    """
    return checked_bench(parse_toml(text, source), source, *checks, folder=Path(source).parent)


def checked_bench(
    values: Mapping[str, Any], source: str, *checks: Check, folder: Path | None = None
) -> BenchDescription:
    """Return the checked bench of nested tables; `source` names it in errors (ConfigError).

    Certificates that it names are found from `folder`, None: from where the program runs.
    """
    if "device" in values:
        return _with_devices(values, source, *checks, folder=folder)
    description = _from(with_stream(values, source, folder or Path()), source)
    for role in ("multimeter", "v_vc_meter"):
        part = getattr(description, role)
        if part is not None and part.calibration_dcc is not None:
            from vcfbench.station.meter_dcc import with_certificate  # noqa: PLC0415  # few benches have one

            part = with_certificate(part, role, source, folder or Path())
            description = replace(description, **{role: part})
    for invalid_value in invalid_values(description):
        raise refusal(f"{source}: {invalid_value.path}", invalid_value.expected, words(invalid_value.came))
    for check in checks:
        check(description, source)
    return description


_OWN = ("gyro", "multimeter", "expected", "acceptance", "uncertainty", "simulation")
"""Tables of a bench file that each of several gyroscopes may have its own keys of."""


def _with_devices(
    values: Mapping[str, Any], source: str, *checks: Check, folder: Path | None = None
) -> BenchDescription:
    """Return a bench with several gyroscopes: each is checked as if it was alone on it."""
    from vcfbench.records.devices import require_serial  # noqa: PLC0415  # few benches have several

    common = {key: each for key, each in values.items() if key != "device"}
    tables = values["device"]
    if not isinstance(tables, list) or len(tables) < 2 or not all(isinstance(each, dict) for each in tables):
        raise refusal(f"{source}: device", "two or more tables [[device]], each with a name", words(tables))
    found: dict[str, BenchDescription] = {}
    for number, table in enumerate(tables, 1):
        where = f"{source}: device {number}"
        name = table.get("name")
        if not isinstance(name, str) or name in found:
            raise refusal(f"{where}.name", "its serial number, each once", words(name))
        require_serial(name)
        own = {key: table[key] for key in _OWN if key in table}
        if unknown := table.keys() - {"name", "resource", "stream", *_OWN}:
            raise unknown_key(min(unknown), ["name", "resource", "stream", *_OWN], f"{where}.{min(unknown)}")
        is_stream = "stream" in table or "stream" in common.get("gyro", {}) or "stream" in own.get("gyro", {})
        if is_stream:
            own["gyro"] = merged(own.get("gyro", {}), {"stream": table.get("stream", {})})
        if "resource" in table:
            at = {"resource": table["resource"]}
            own = merged(own, {"gyro": {"stream": at}} if is_stream else {"multimeter": at})
        found[name] = checked_bench(merged(common, own), f"{where} ({name})", *checks, folder=folder)
    description = next(iter(found.values())).with_devices([*found], [*found.values()])
    for invalid_value in shared_wires(description):
        raise refusal(f"{source}: {invalid_value.path}", invalid_value.expected, words(invalid_value.came))
    for check in checks:
        check(description, source)
    return description


def _from(values: Mapping[str, Any], source: str) -> BenchDescription:
    # Filled in is what need not be said of an instrument that a person sets and reads
    filled = dict(values)
    for role, part in values.items():
        if isinstance(part, dict) and part.get("by") == "hand" and not {"simulation", "served"} & values.keys():
            own = {"resource": f"hand://{values.get('name')}/{role}", "timeout_s": _CONFIRMS_S}
            filled[role] = own | ({"dialect": "hand"} if role == "rate_table" else {}) | part
    return converted(filled, BenchDescription, lambda keys: f"{source}: {dotted(keys)}")


_CONFIRMS_S = 30.0
"""A quarter of the time in which a person must confirm that something is off."""


def template() -> str:
    """Return the commented bench file of a real station, ready to be filled in."""
    return embedded_text("station")


def embedded_text(name: str) -> str:
    """Return the text of the bench file `name` that comes with the package."""
    return resources.files("vcfbench.station").joinpath(f"{name}.toml").read_text(encoding="utf-8")


def _embedded(name: str) -> BenchDescription:
    """Return a bench that comes with the package; that it agrees with itself is tested, and costs imports to see."""
    source = f"embedded {name} bench"
    return _from(parse_toml(embedded_text(name), source), source)
