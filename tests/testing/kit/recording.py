"""Bundles that the kit records of simulated instruments."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pyvisa
from simrack.scpi import ScpiError
from simrack.scpi.parameters import Boolean, Choice, Number, Text

from vcfbench.testing.kit import program, write

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from random import Random


def library(*models: str) -> str:
    return f"?speed=max&models={','.join(models)}@simrack"


def recorded(path: Path, *models: str, driven: bool = True) -> int:
    """Let the kit record instruments of these models in turn; return its exit code."""
    program.scripts = write.scripts  # what is packed into the file
    asked = iter([word for model in models for word in (("y", model) if driven else ("n",))])
    names = pyvisa.ResourceManager(library(*models)).list_resources("?*")
    return program.main([*names, "--library", library(*models), "--output", str(path)], lambda _: next(asked))


def left_anyhow(model: str, random: Random) -> None:
    """Leave a model's settings as a last user may have: any of those that its rows take."""
    manager = pyvisa.ResourceManager(library(model))
    device: Any = manager.open_resource(manager.list_resources("?*")[0])
    for message in _settings(model, random):
        device.write(message)
    device.write("*CLS")


def _settings(model: str, random: Random) -> Iterator[str]:
    device, _ = write.twin(model)
    for row in type(device).table.commands:  # type: ignore[attr-defined]
        if row.reads and row.do and len(row.parameters) == 1 and random.random() < 0.5:
            header = write.questions(type(device).table.__class__(row))[-1].removesuffix("?")
            with suppress(ScpiError, KeyError, AttributeError, ValueError):
                yield f"{header} {_value(row.parameters[0], device, random)}"


def _value(parameter: Any, device: Any, random: Random) -> str:
    if isinstance(parameter, Boolean):
        return random.choice(("ON", "OFF"))
    if isinstance(parameter, Choice):
        return random.choice(parameter.mnemonics).short
    if isinstance(parameter, Text):
        return '"MY53001234"'
    if isinstance(parameter, Number):
        low, high, _ = parameter.bounds(device)
        return f"{random.uniform(low, high):.6g}"
    raise KeyError(parameter)
