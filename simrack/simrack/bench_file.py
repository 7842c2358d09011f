"""A bench in a file: instruments, circuits between named nodes, loads, faults.

::

    seed = 1                      # specimens with errors; without it they are ideal

    [instruments.source]
    model = "33522B"              # or a class in `file`
    wires = ["hislip", "tcp"]     # without it those of the real box; ["gpib22"] is behind an adapter
    output_1 = "drive"            # each terminal by its node; "-drive" is the wrong way round
    output_2 = "clock"

    [instruments.meter]
    model = "34461A"
    input = "filtered"

    [circuits.filter]
    file = "rc_filter.py"         # beside this file; defines CIRCUIT
    input = "drive"
    output = "filtered"

    [loads]
    filtered = 1e6                # ohm, to ground

    [[fault]]                     # as of simrack.faults
    instrument = "meter"
    kind = "late"

An output of which nothing is said is on a node of its own, `source.output_2`; an input hangs free.
"""

from __future__ import annotations

import re
import runpy
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from simrack.faults import FaultScript, script_of
from simrack.models import SimulatedModel, model_named
from simrack.plan import Place, Plan, circuit_in, own_models, plan_of, with_adapter
from simrack.wired import Through

_NAME, _NODE = re.compile(r"[\w-]+"), re.compile(r"[\w.][\w.-]*")
_PARTS = ("seed", "instruments", "circuits", "loads", "fault")


def planned(words: Iterable[str]) -> Plan:
    """Return the plan of a command's words, or of the one bench file among them.

    Raises:
        ValueError: as of :func:`plan_in` and :func:`~simrack.plan.plan_of`, or other words stand beside a bench file.
        OSError: a file cannot be read.
    """
    listed = list(words)
    files = [word for word in listed if word.endswith(".toml")]
    if not files:
        return plan_of(listed)
    if len(listed) > 1:
        raise ValueError(f"{files[0]} describes the whole bench; remove the other arguments: {', '.join(listed)}")
    return plan_in(Path(files[0]))


def plan_in(file: Path) -> Plan:
    """Return the plan of a bench file.

    Raises:
        ValueError: it is no TOML, or says what no bench has; with the place in the file.
        OSError: it, or a file that it names, cannot be read.
    """
    said = tomllib.loads(file.read_text(encoding="utf-8"))
    try:
        _only(said, _PARTS, "the file")
        places = tuple(_place(name, each, file.parent) for name, each in _table(said, "instruments").items())
        links = dict(_link(name, each, file.parent) for name, each in _table(said, "circuits").items())
        loads = {node: _number(ohm, f"loads.{node}") for node, ohm in _table(said, "loads").items()}
        seed = said.get("seed")
        if seed is not None and (type(seed) is not int or seed < 0):
            raise ValueError(f"seed: expected a whole number from 0 on, got {seed!r}")  # noqa: TRY301
        script = FaultScript(script_of({"fault": said.get("fault", [])}).faults, seed or 0)
        return Plan(with_adapter(places), links, loads, script, seed)
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from error


def _table(said: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    found = said.get(name, {})
    if not isinstance(found, dict):
        raise ValueError(f"{name}: expected [{name}...], got {found!r}")  # noqa: TRY004  (what a user wrote)
    return found


def _only(said: Any, known: Iterable[str], where: str) -> None:
    known = tuple(known)
    if not isinstance(said, dict) or set(said) - set(known):
        came = ", ".join(sorted(set(said) - set(known))) if isinstance(said, dict) else repr(said)
        raise ValueError(f"{where}: expected {', '.join(known)}, got {came}")


def _text(said: Mapping[str, Any], name: str, where: str) -> str:
    found = said.get(name)
    if not isinstance(found, str) or not found:
        raise ValueError(f"{where}.{name}: expected a text, got {found!r}")
    return found


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not value > 0:
        raise ValueError(f"{where}: expected ohms above 0, got {value!r}")
    return float(value)


def _place(name: str, said: Any, folder: Path) -> Place:
    where = f"instruments.{name}"
    if not _NAME.fullmatch(name):
        raise ValueError(f"{where}: expected a name of letters, digits, - and _")
    known = said if isinstance(said, dict) else {"model": said}
    own: dict[str, SimulatedModel] = {}
    if "file" in known:
        own = own_models(runpy.run_path(str(folder / _text(known, "file", where))))
    try:
        model = model_named(_text(known, "model", where), own)
        wires = known.get("wires", [])
        if not isinstance(wires, list) or not all(isinstance(each, str) for each in wires):
            raise ValueError(f"wires: expected a list of texts, got {wires!r}")  # noqa: TRY301
        placed = Place(name, model).on(wires)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None
    terminals = (*model.outputs, *model.inputs)
    _only(said, ("model", "wires", "file", *terminals), where)
    nodes: dict[str, str | None] = {each: f"{name}.{each}" if each in model.outputs else None for each in terminals}
    for each in known.keys() & {*terminals}:
        nodes[each] = node = _text(known, each, where)
        turns = model.kind == "supply" or each in model.inputs
        if not _NODE.fullmatch(node.removeprefix("-") if turns else node):
            raise ValueError(f"{where}.{each}: expected the name of a node, got {node!r}")
    return replace(placed, terminals=nodes)


def _link(name: str, said: Any, folder: Path) -> tuple[str, Through]:
    where = f"circuits.{name}"
    _only(said, ("file", "input", "output"), where)
    circuit = circuit_in(folder / _text(said, "file", where)) if "file" in said else None
    return _text(said, "output", where), Through(_text(said, "input", where), circuit)
