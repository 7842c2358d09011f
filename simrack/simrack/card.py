"""Conformance card of a model: its commands against its manual and the standards, with the sources.

Made of its command table, of the docstring that names its sources, and of the headers of its manual or, where that was
not at hand, of drivers and notes (`simrack/manuals`; the card says which). A header that a model does not know is
answered as a real one answers an unknown header.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from importlib.resources import files
from itertools import product
from typing import Final

from msgspec import Struct
from msgspec.structs import replace

from simrack.models import MODELS, RACK, SimulatedModel
from simrack.scpi import CommandTable

IEEE_488_2: Final = (
    *("*CLS", "*ESE", "*ESE?", "*ESR?", "*IDN?", "*OPC", "*OPC?", "*RST", "*SRE", "*SRE?", "*STB?", "*TST?", "*WAI"),
)
"""What IEEE 488.2, 4.1.1 demands."""
SCPI_99: Final = (
    *("SYSTem:ERRor[:NEXT]?", "SYSTem:VERSion?", "STATus:{OPERation|QUEStionable}[:EVENt]?", "STATus:PRESet"),
    *("STATus:{OPERation|QUEStionable}:CONDition?", "STATus:{OPERation|QUEStionable}:ENABle"),
)
"""What SCPI-99, volume 1, 4.2.1 demands."""
_UNKNOWN = -113
_OTHERS = "this model has not, unknown headers here as there"


class Index(Struct, frozen=True):
    """The headers of a list, known and unknown to a model, and the source of the list."""

    source: str
    known: tuple[str, ...]
    unknown: tuple[str, ...]
    drivers: Mapping[str, str] = {}
    """In how many drivers in public use a header is, where it is in any."""
    others: Mapping[str, str] = {}
    """Headers of the list that are of other models, and of which."""

    def __str__(self) -> str:
        """Return the number of known ones."""
        return f"{len(self.known)} of {len(self.known) + len(self.unknown)}"


def spellings(header: str) -> Iterator[str]:
    """Yield all forms of a printed header: with and without `[:STATe]`, each of `{LOWer|UPPer}`."""
    pieces = re.split(r"(\[[^]]*\]|\{[^}]*\})", header)
    choices = [
        (piece[1:-1], "") if piece[:1] == "[" else piece[1:-1].split("|") if piece[:1] == "{" else (piece,)
        for piece in pieces
    ]
    for chosen in product(*choices):
        yield "".join(chosen)


def knows(table: CommandTable, header: str) -> bool:
    """Return True if a table has a header in every spelling: as a query if it ends with ?, else in either form."""

    def found(text: str) -> bool:
        error = table.compile(text)[0].error
        return error is None or error.number != _UNKNOWN

    return all(found(each) or (each[-1] != "?" and found(f"{each}?")) for each in spellings(header))


def compared(table: CommandTable, headers: tuple[str, ...], source: str) -> Index:
    """Return which of some headers a table has."""
    known = tuple(each for each in headers if knows(table, each))
    return Index(source, known, tuple(each for each in headers if each not in known))


def of_manual(model: SimulatedModel) -> Index:
    """Return the headers of the manual's list that a model knows.

    In a file of `manuals` the number of drivers stands behind a tab, and behind another which models have not the
    header, * for all, and why: `34461A: a 34465A has it`.
    """
    source, *lines = (files("simrack") / "manuals" / model.index).read_text(encoding="utf-8").splitlines()
    rows = [(*line.split("\t"), "", "")[:3] for line in lines]
    drivers = {header: number for header, number, _ in rows}
    lacking = ((header, *note.partition(": ")) for header, _, note in rows)
    others = {header: why for header, models, _, why in lacking if {model.name, "*"} & {*models.split()}}
    headers = tuple(each for each in drivers if each not in others)
    found = compared(model.load().table, headers, source.removeprefix("# "))
    return replace(found, drivers=drivers, others=others)


def card(name: str) -> str:
    """Return the card of a model in Markdown.

    Raises:
        KeyError: there is no such model.
    """
    return f"## {name}\n\n{_said_of(RACK[name])}"


def _said_of(model: SimulatedModel) -> str:
    lines = [f"- served on: {', '.join(model.wires)}"]
    if not model.index:
        return "\n".join([*lines, "", *model.description().rstrip().splitlines()])
    table, manual = model.load().table, of_manual(model)
    lines.append(f"- commands: {len(table.commands)} headers")
    for standard in (compared(table, IEEE_488_2, "IEEE 488.2, 4.1.1"), compared(table, SCPI_99, "SCPI-99, 4.2.1")):
        lacking = ", ".join(f"`{each}`" for each in standard.unknown)
        lines.append(f"- {standard.source}: {f'lacks {lacking}' if lacking else 'all there'}")
    lines.append(f"- {manual.source}: {manual} known")
    lines += ["", *model.description().rstrip().splitlines()]
    for said, headers in (("are not known", manual.unknown), (_OTHERS, manual.others)):
        if headers:
            lines += ["", f"Lines of that list that {said} (and in how many of the drivers they are):", "", "```scpi"]
            lines += [*(_with_drivers(manual, each) for each in headers), "```"]
    return "\n".join(lines)


def _with_drivers(manual: Index, header: str) -> str:
    number, why = manual.drivers[header], manual.others.get(header, "")
    return header + (number and f" ({number})") + (why and f" # {why}")


def overview() -> str:
    """Return a row for each model: the number of headers, and the numbers that standards and manual list."""
    rows = ["| model | served on | headers | IEEE 488.2 | SCPI-99 | its list |", "|---|---|---:|---:|---:|---:|"]
    for name, model in MODELS.items():
        table, manual = model.load().table, of_manual(model)
        lists = (compared(table, IEEE_488_2, ""), compared(table, SCPI_99, ""), manual)
        rows.append(f"| {name} | {', '.join(model.wires)} | {len(table.commands)} | {' | '.join(map(str, lists))} |")
    return "\n".join(rows)


def page() -> str:
    """Return the overview and all cards, those that say the same as one."""
    names: dict[str, list[str]] = {}
    for name, model in MODELS.items():
        names.setdefault(_said_of(model), []).append(name)
    cards = (f"## {', '.join(alike)}\n\n{said}" for said, alike in names.items())
    return "\n\n".join(["# Conformance", __doc__.strip(), overview(), *cards]) + "\n"


if __name__ == "__main__":
    print(page(), end="")  # noqa: T201
