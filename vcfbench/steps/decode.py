"""Steps and results made from lines of a journal again, by the name of their kind.

A kind that is not known here, since the file or package that brought it is not imported, or whose fields are those of
another version, comes back as it was written: :class:`Recorded`.
"""

from collections.abc import Mapping
from typing import Any, TypeVar

import msgspec
from msgspec import Struct

import vcfbench.steps  # noqa: F401  # its kinds make themselves known
from vcfbench.steps.step import Step, StepResult
from vcfbench.typed import typed

_T = TypeVar("_T")


class Recorded(Struct, frozen=True):
    """A step or a result of an unknown kind, with its fields of the journal."""

    kind: str
    values: Mapping[str, Any]

    def describe(self) -> str:
        return f"{self.kind}({', '.join(f'{name}={value!r}' for name, value in self.values.items())})"


def step_of(line: Mapping[str, Any]) -> Step | Recorded:
    """Return the step of a line of type `step`, `readings` or `error`; KeyError where the line has none."""
    return _made(Step.kinds, line["step_kind"], line["step"])


def result_of(line: Mapping[str, Any]) -> StepResult | Recorded:
    """Return the result of a line of type `step`; KeyError where the line has none."""
    kind, values = line["result_kind"], line["result"]
    step = step_of(line)
    if kind not in StepResult.kinds or isinstance(step, Recorded):
        return Recorded(kind, values)
    return _made(StepResult.kinds, kind, step.recorded(values))


def _made(kinds: Mapping[str, type[_T]], kind: str, values: Mapping[str, Any]) -> _T | Recorded:
    if kind not in kinds:
        return Recorded(kind, values)
    try:
        return typed(values, kinds[kind])
    except msgspec.ValidationError:
        return Recorded(kind, values)
