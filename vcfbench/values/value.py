"""One value of a run's results: a number that keeps its kind, its unit, its uncertainty and its form."""

import math
from collections.abc import Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any, Final, Literal, Self, get_args

from msgspec import Struct, structs
from msgspec.structs import force_setattr

from vcfbench.errors import ConfigError
from vcfbench.values.definition import Conditions, Definition
from vcfbench.values.kinds import KINDS, Named, fits, kind_of, named
from vcfbench.values.printing import digits_of_value, grouped, in_digits, in_threes, incomplete, shorthand
from vcfbench.values.quantile import t_quantile

Form = Literal["plus-minus", "interval", "size-below", "below", "at-least"]
"""What is stated with 95 %: value +- U95; a value with a lopsided interval; |value| below; from 0 to below; at least.

A value in the first form may have no uncertainty, then it is a number alone.
"""
_UNCOVERED = 0.05
"""Chance of a true value outside of what is stated."""


class UncertaintyPart(Struct, frozen=True):
    """Contribution of one source to a standard uncertainty, in the unit of the value; the sign is that of its effect.

    `of` says whose it is where other results have the same, so that it cancels between them: an instrument, a
    certificate. None is this result's own.
    """

    source: str
    u: float
    dof: float | None = None
    of: str | None = None
    rectangular: bool = False
    """True if any value within a limit is as likely; else it is normal, or Student's t."""

    def in_results(self) -> dict[str, Any]:
        """Return it as the results in ``result.json`` have it."""
        return structs.asdict(self)


_NUMBERS: Final = ("value", "u", "dof", "u95", "low", "high")
_TYPES: Final[dict[str, Any]] = {
    **dict.fromkeys(("name", "unit", "kind", "words", "of"), str),
    "parts": UncertaintyPart,
    "missing": str,
    "definition": Definition,
    "conditions": Conditions,
}
_USUAL: Final = ({str}, {UncertaintyPart}, Definition, Conditions)


class Value(Struct, frozen=True):
    """A stated value of a run, in SI units but for rates (deg/s).

    `name` is unique in the run (``turntable.scale_factor``); where it has none, that of its place in the results is.
    `kind` says what it is of: a key of :data:`vcfbench.values.kinds.KINDS`, or nothing. `low` and `high` are the ends
    of what holds with 95 % where that is not value +- U95; of a bound `value` is what was found, if anything was. A `u`
    without `u95` gets the factor of Student's t for its `dof` (None: as many as one likes).

    Raises:
        ConfigError: a field is of another type, a number not finite, an uncertainty negative, a `u` without `u95` has
            no degrees of freedom, the form is unknown or lacks its ends, or the kind has another unit.

    >>> value = run.values["scale_factor"]
    >>> f"{value}, U95 {value.u95:.2g} {value.unit}"
    '-12.5630(29) mV/(deg/s), U95 6.4e-06 V/(deg/s)'
    """

    name: str
    value: float | None
    unit: str = ""
    u: float | None = None
    dof: float | None = None
    u95: float | None = None
    form: Form = "plus-minus"
    low: float | None = None
    high: float | None = None
    kind: str = ""
    words: str = ""
    """What it is called, where neither its kind nor its name says that."""
    of: str = ""
    """What it is, in a sentence."""
    parts: Sequence[UncertaintyPart] = ()
    missing: Sequence[str] = ()
    """Contributions that its uncertainty lacks because nobody tells them; none where it is complete."""
    definition: Definition = Definition()
    """What it is of, beside its kind: values of which that differs are not compared."""
    conditions: Conditions = Conditions()

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        force_setattr(self, "parts", _several(self.parts))
        force_setattr(self, "missing", _several(self.missing))
        _hold_numbers(self)
        texts = (self.name, self.unit, self.kind, self.words, self.of, *self.missing)
        parts = {UncertaintyPart, *map(type, self.parts)}
        if ({*map(type, texts)}, parts, type(self.definition), type(self.conditions)) != _USUAL:
            _hold_types(self)
        kind = KINDS.get(self.kind)
        if self.kind and not fits(self.kind, self.unit):
            of = self.kind if kind is None else f"{kind.words} in {kind.si or 'no unit'}"
            raise ConfigError(f"{self.name}: expected {of}, got {self.unit!r}")
        if self.u is not None and self.u95 is None and self.form == "plus-minus":
            dof = math.inf if self.dof is None else self.dof
            force_setattr(self, "u95", t_quantile(_UNCOVERED, dof) * self.u)
        low, high = self.ends
        within = self.value is None or low <= abs(self.value) <= high if self.form == "size-below" else True
        if self.form == "interval":
            within = self.value is not None and low <= self.value <= high
        if self.form != "plus-minus" and not (low <= high and within):
            raise ConfigError(f"{self.name}: {self.form} cannot be {self.value}, from {self.low} to {self.high}")
        if self.form == "plus-minus" and self.value is None:
            raise ConfigError(f"{self.name}: expected a value, got none")

    @property
    def ends(self) -> tuple[float, float]:
        """The ends of the interval that holds with 95 %; of a value without U95 both are the value."""
        low, high = (math.nan if each is None else each for each in (self.low, self.high))
        match self.form:
            case "size-below":
                return -high, high
            case "below":
                return 0.0, high
            case "at-least":
                return low, math.inf
            case "interval":
                return low, high
            case "plus-minus":
                value, u95 = self.value or 0.0, self.u95 or 0.0
                return value - u95, value + u95
        raise ConfigError(f"{self.name}: expected a form of {', '.join(get_args(Form))}, got {self.form!r}")

    @property
    def coverage_factor(self) -> float | None:
        """The expanded uncertainty over the standard one, or None."""
        return self.u95 / self.u if self.u and self.u95 is not None else None

    @property
    def named(self) -> Named:
        """Words for it, and the unit in which people read it."""
        found = named(self.name, self.unit, self.kind)
        return found._replace(words=self.words, german="") if self.words else found

    def called(self, name: str, kind: str | None = None, words: str = "") -> Self:
        """Return it under a name; of the kind that has its name and unit where none is said."""
        kind = kind_of(name, self.unit) if kind is None else kind
        return structs.replace(self, name=name, kind=kind, words=words or self.words)

    def figure(self, factor: float = 1.0) -> str:
        """Return the figure, `factor` times the value, in its form: ``-12.541 66(58)``, ``below 0.000 91``."""
        size, (low, high) = abs(factor), sorted(factor * each for each in self.ends)
        if self.form == "size-below":
            return f"size below {grouped(high)}"
        if self.form == "below":
            return f"below {grouped(max(-low, high))}"
        if self.form == "at-least":
            return f"at least {grouped(size * self.ends[0])}"
        found = factor * (self.value or 0.0)
        if self.form == "interval":
            middle, *ends = (f"{'-' * (each < 0.0)}{grouped(abs(each))}" for each in (found, low, high))
            return f"{middle} ({' to '.join(ends)})"
        if self.u is None and self.u95:
            return in_threes(in_digits(found, digits_of_value(found, size * self.u95)))
        ratio = self.kind and KINDS[self.kind].digits
        return format(found, ratio) if ratio else shorthand(found, None if self.u is None else size * self.u)

    def found_in_bound(self, factor: float = 1.0) -> str:
        """Return ``(found: 812)`` behind a bound, `factor` times the value that was found; nothing of other forms."""
        if self.form not in {"size-below", "below", "at-least"} or self.value is None:
            return ""
        return f" (found: {in_threes(in_digits(factor * self.value, '.4g'))})"

    def __str__(self) -> str:
        """Return the value in the unit in which people read it."""
        of = self.named
        return f"{self.figure(of.factor)} {of.unit}".rstrip() + incomplete(self.missing)

    @property
    def with_u95(self) -> str:
        """Return the value in the unit in which people read it, with its U95 if it has one."""
        of = self.named
        u95 = f", U95 {grouped(abs(of.factor) * self.u95)}" if self.u95 else ""
        return f"{self.figure(of.factor)} {of.unit}".rstrip() + u95

    def in_results(self) -> dict[str, Any]:
        """Return it as the results in ``result.json`` have it, by the names of ever since."""
        return {**structs.asdict(self), "conditions": self.conditions.as_json()}

    def as_json(self) -> dict[str, Any]:
        """Return it as ``values`` of ``result.json`` have it: without the parts of its uncertainty, which results have.

        `ends` are those of what holds with 95 %, null where there is none.
        """
        ends = [each if math.isfinite(each) else None for each in self.ends]
        said = {"name": self.name, "kind": self.kind, "words": self.named.words, "unit": self.unit}
        numbers = {"value": self.value, "u": self.u, "dof": self.dof, "u95": self.u95, "form": self.form, "ends": ends}
        holds = {"definition": self.definition.as_json(), "conditions": self.conditions.as_json()}
        return {**said, **numbers, "low": self.low, "high": self.high, "missing": list(self.missing), **holds}


def _hold_numbers(value: "Value") -> None:
    for name in _NUMBERS:
        number = getattr(value, name)
        if number is not None and type(number) is not float:  # numpy's become plain ones
            number = number.tolist() if hasattr(number, "tolist") else number
            if not isinstance(number, Real) or isinstance(number, bool):
                raise _refused(value, name, "a number or None", number)
            force_setattr(value, name, number := float(number))
        if number is not None and not math.isfinite(number):
            raise ConfigError(f"{value.name}: expected finite numbers, got {number}")
        if name in {"u", "u95"} and number is not None and number < 0.0:
            raise ConfigError(f"{value.name}: expected an uncertainty of 0 or more, got {number:g}")


def _hold_types(value: "Value") -> None:
    for name, kind in _TYPES.items():
        given = getattr(value, name)
        for each in given if isinstance(given, tuple) else (given,):
            if not isinstance(each, kind):
                raise _refused(value, name, "a text" if kind is str else kind.__name__, each)


def _refused(value: "Value", name: str, expected: str, came: object) -> ConfigError:
    return ConfigError(f"{value.name}: {name}: expected {expected}, got {came!r:.60}")


def _several(given: Any) -> tuple[Any, ...]:
    return (given,) if isinstance(given, str) or not hasattr(given, "__iter__") else tuple(given)


class Measurand(Value, frozen=True):
    """A value +- U95 with its combined standard uncertainty, all sources in it; their parts add up in squares."""

    if TYPE_CHECKING:
        value: float
        u: float = 0.0
        u95: float = 0.0
        parts: tuple[UncertaintyPart, ...] = ()
        missing: tuple[str, ...] = ()

    def bound(self, form: Literal["size-below", "below"], high: float, of: str = "") -> Value:
        """Return the bound that remains of it if it may be noise or errors alone."""
        parts = [UncertaintyPart(each.source, each.u, each.dof, each.of, each.rectangular) for each in self.parts]
        value = Value(self.name, self.value, self.unit, form=form, high=high, kind=self.kind, words=self.words)
        return structs.replace(value, of=of or self.of, parts=parts, missing=self.missing)

    def in_results(self) -> dict[str, Any]:
        """Return it as the results in ``result.json`` have it."""
        whole = {"complete": not self.missing, "missing": self.missing}
        factor = {"coverage_factor": self.coverage_factor, "expanded_u": self.u95, "parts": self.parts}
        return {"value": self.value, "u": self.u, "unit": self.unit, "dof": self.dof, **factor, **whole}


class Unstated(Struct, frozen=True):
    """A value that a run should have found and could not: no limit of it is kept."""

    name: str
    kind: str = ""
