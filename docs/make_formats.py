# noqa: INP001 - a script, not a package
"""Makes the page of the formats: steps and results of records, entries of devices, bounds of bench files.

The site has it (docs/site_hook.py); `python docs/make_formats.py` prints it. All of it comes from the classes.
"""

from __future__ import annotations

import inspect as source
import math
import re
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec import NODEFAULT, Struct, inspect, structs

import vcfbench.steps
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.procedures.virtual_coriolis.settings import VirtualCoriolisSettings
from vcfbench.records import device_values, devices
from vcfbench.station.description import BenchDescription
from vcfbench.station.settings import ProcedureSettings
from vcfbench_tables import language

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

HEAD = """\
# Formats

Fields of [records](records.md) and of [devices](devices.md), keys of [table profiles](rate-tables.md), the bounds of
[bench files](bench-file.md), and the instruments of [procedures](procedures/index.md), made from the program. The unit
is at the end of a field's name.
"""
ENTRIES = (
    *(devices.Certificate, devices.KvcCurve, devices.CurveShare, device_values.Sensitivity, devices.SelfCalibration),
    *(devices.Characterisation, device_values.Characteristics, devices.StaticNoise, devices.Withdrawal),
    *(device_values.Conditions, device_values.Measured, device_values.Share),
)
PROFILE = {
    "Top level": language.Profile,
    "`[link]`": language.ProfileLink,
    "`[frame]`, `[reply_frame]`": language.Frame,
    "`[units]`": language.Units,
    "A step of `[commands]`": language.Step,
    "`[replies]`": language.Reply,
    "A byte of a reply": language.Byte,
    "`[refusals]`": language.Refusals,
    "`[fields]`": language.Field,
    "`[status]`": language.Flag,
    "`[stream]`": language.Stream,
    "`[requires]`": language.Requirement,
    "`[at_rate]`": language.AtRate,
    "`[safety]`": language.Safety,
}


def formats_page() -> str:
    """Return the page."""
    kinds = (kind for kind in vcfbench.steps.Step.kinds.values() if ours(kind))
    results = (kind for kind in vcfbench.steps.StepResult.kinds.values() if ours(kind))
    parts = [HEAD, "## Steps\n", *kinds_table(kinds), "\n## Results of steps\n", *kinds_table(results)]
    parts += ["\n## Entries of devices\n", "Each entry also has `format` (1) and `kind`.\n"]
    for kind in ENTRIES:
        parts += [f"### {kind.__name__}\n", f"{first_line(kind)}\n", "| field | content |", "|---|---|"]
        parts += [f"| `{name}` | {words} |" for name, words in said_of(kind).items()] + [""]
    parts += ["## Keys of a table profile\n"]
    for head, kind in PROFILE.items():
        parts += [f"### {head}\n", "| key | default | content |", "|---|---|---|", *keys_of(kind), ""]
    parts += ["## Bounds of a bench file\n", "| key | least | most |", "|---|---:|---:|"]
    parts += [f"| `{key}` | {least:g} | {most:g} |" for key, (least, most) in bench_bounds().items()]
    parts += [
        "\n## Instruments of each procedure\n",
        "| procedure | needs | one of (`by`) | uses if present |",
        "|---|---|---|---|",
    ]
    parts += needs_rows()
    return "\n".join(parts) + "\n"


def needs_rows() -> list[str]:
    """Return the rows of a table of the roles that each procedure needs, and those that it uses."""
    cells = {
        name: (kind.needs, kind.either, [role for role in kind.uses if role not in kind.needs])
        for name, kind in PROCEDURES.items()
    }
    return [
        f"| `{name}` | {' | '.join(', '.join(f'`{role}`' for role in roles) for roles in each)} |"
        for name, each in cells.items()
    ]


def ours(kind: type[Any]) -> bool:
    """Return whether a kind of step is built in."""
    return kind.__module__.startswith("vcfbench.")


def kinds_table(kinds: Iterator[type[Any]]) -> list[str]:
    """Return the rows of a table of steps or results."""
    rows = (
        f"| `{kind.__name__}` | {first_line(kind)} | {', '.join(f'`{each}`' for each in kind.__struct_fields__)} |"
        for kind in sorted(kinds, key=lambda kind: kind.__name__)
    )
    return ["| kind | what it does | fields |", "|---|---|---|", *rows]


def first_line(kind: type[Any]) -> str:
    """Return the first line of a docstring, as Markdown."""
    line = (kind.__doc__ or "").strip().partition("\n")[0]
    return re.sub(r":\w+:`~?([^`]+)`", r"`\1`", line).replace("``", "`").replace("|", "\\|")


def said_of(kind: type[Any]) -> dict[str, str]:
    """Return the comment behind each field of a class, in its source."""
    text = source.getsource(kind)
    found = re.findall(r"^    (\w+): [^#\n]*?(?:  # (.*))?$", text, flags=re.MULTILINE)
    return {name: words.replace("|", "\\|") for name, words in found if name in kind.__struct_fields__}


def keys_of(kind: type[Any]) -> list[str]:
    """Return the rows of a table of the profile: key, default, and the comment with the values that a key may have."""
    words = {
        name: said
        for each in reversed(kind.__mro__)
        if issubclass(each, Struct) and each is not Struct
        for name, said in said_of(each).items()
    }
    rows = []
    for field, known in zip(structs.fields(kind), inspect.type_info(kind).fields, strict=True):
        optional = field.default in (None, NODEFAULT, math.inf)
        default = "" if optional else f"`{msgspec.json.encode(field.default).decode()}`"
        default = "required" if field.required else default
        values = [each for part in options(known.type) for each in part.values]
        listed = f"; {', '.join(f'`{each}`' for each in values)}" if values else ""
        rows.append(f"| `{field.encode_name}` | {default} | {words[field.name]}{listed} |")
    return rows


def options(node: inspect.Type) -> Iterator[inspect.LiteralType]:
    """Yield the lists of allowed values of a type."""
    if isinstance(node, inspect.LiteralType):
        yield node
    elif isinstance(node, inspect.UnionType):
        for part in node.types:
            yield from options(part)


def bench_bounds() -> Mapping[str, tuple[float, float]]:
    """Return least and largest of every number that a bench file may have, by its key."""
    common = bounds(inspect.type_info(ProcedureSettings), "procedure")
    own = bounds(inspect.type_info(VirtualCoriolisSettings), "procedure.virtual-coriolis")
    others = {path: limits for path, limits in own.items() if path.replace(".virtual-coriolis", "") not in common}
    return bounds(inspect.type_info(BenchDescription)) | common | others


def bounds(node: object, path: str = "") -> dict[str, tuple[float, float]]:
    """Return least and largest of every number of a type, by its path."""
    found: dict[str, tuple[float, float]] = {}
    if isinstance(node, inspect.StructType):
        for field in node.fields:
            if field.name != "station":
                found |= bounds(field.type, f"{path}.{field.encode_name}".removeprefix("."))
    elif isinstance(node, inspect.Metadata | inspect.UnionType | inspect.TupleType | inspect.VarTupleType):
        for part in parts_of(node):
            found |= bounds(part, path)
    elif isinstance(node, inspect.FloatType | inspect.IntType):
        if node.ge is None or node.le is None:
            msg = f"{path} has no bounds"
            raise ValueError(msg)
        found[path] = (float(node.ge), float(node.le))
    return found


def parts_of(
    node: inspect.Metadata | inspect.UnionType | inspect.TupleType | inspect.VarTupleType,
) -> tuple[inspect.Type, ...]:
    """Return the types that a type is made of."""
    match node:
        case inspect.Metadata():
            return (node.type,)
        case inspect.UnionType():
            return node.types
        case inspect.TupleType():
            return node.item_types[:1]
    return (node.item_type,)


if __name__ == "__main__":
    print(formats_page(), end="")  # noqa: T201
