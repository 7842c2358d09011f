"""The values of a run as its results state them, each with unit, uncertainty and form, in their order."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, Protocol, runtime_checkable

from vcfbench.errors import ConfigError
from vcfbench.records.plain import field_names, plain
from vcfbench.values.kinds import KINDS, LIMITED, kind_of
from vcfbench.values.value import UncertaintyPart, Unstated, Value


@runtime_checkable
class StatesValues(Protocol):
    """Results that say themselves which values they state, under which names and in which order."""

    def stated(self) -> Iterator[Value | Unstated]:
        """Yield the values, and those that could not be found."""
        ...


@runtime_checkable
class LeavesOut(Protocol):
    """The part of results, or of a statement, that lists what uncertainties do not contain."""

    not_in_u: Sequence[str]


@runtime_checkable
class HoldsNot(Protocol):
    """The same of K_Vc and what goes by it: results under another name, which records have."""

    holds_not: Sequence[str]


@runtime_checkable
class Refuses(Protocol):
    """Results that cannot state the main value of a run."""

    def refusal(self) -> str:
        """Return the reason, or "" with a value."""
        ...


@runtime_checkable
class InParts(Protocol):
    """Results that are those of several procedures, each with its name and `results`."""

    parts: Sequence[Any]
    not_measured: Sequence[Any]


NOT_CONTAINED: Final = "not contained in any uncertainty:"
BEYOND_SHEETS = "instruments outside their data sheets and certificates: all are assumed to be within"


def left_out(results: object) -> Sequence[str]:
    """Return the sources in no uncertainty of results: those of all, and those that these results name."""
    if isinstance(results, Mapping):  # of a record whose code is not known
        statement = results.get("uncertainty")
        of_line = statement.get("not_in_u") if isinstance(statement, Mapping) else None
        own = of_line or results.get("holds_not") or ()
    elif isinstance(results, HoldsNot):
        own = results.holds_not
    else:
        within = (results, *(getattr(results, name) for name in field_names(results) or ()))
        own = next((each.not_in_u for each in within if isinstance(each, LeavesOut)), ())
    known = [each for each in values_of(results).values() if each.u95 is not None or each.form != "plus-minus"]
    return own if not known or BEYOND_SHEETS in own else (BEYOND_SHEETS, *own)


def values_of(results: object) -> dict[str, Value]:
    """Return the values that the results of a run state, by name, in their order.

    Raises:
        ConfigError: two of them have one name.
    """
    found: dict[str, Value] = {}
    for each in stated(results):
        if each.name in found:
            raise ConfigError(f"results: expected one value of a name, got two named {each.name}")
        if isinstance(each, Value):
            found[each.name] = each
    return found


def stated(results: object) -> Iterator[Value | Unstated]:
    """Yield the values that results state, and those that could not be found.

    Results that say themselves which they are (``stated()``) are asked. In any others they are found by type: in
    fields, mappings, and tuples of them; and of plain numbers those that have the name of a limit.
    """
    if isinstance(results, Mapping) and "uncertainty" in results:
        yield from _of_before(results)
    else:
        yield from _found(results, "")


def _found(of: object, name: str) -> Iterator[Value | Unstated]:
    """Yield the values in `of`, going down by names."""
    if isinstance(of, StatesValues):
        yield from of.stated()
    elif isinstance(of, Value):
        yield of if of.name else of.called(name, of.kind or None)
    elif isinstance(of, tuple | list):
        yield from (each for each in of if isinstance(each, Value) and each.name)
    else:
        names = of.keys() if isinstance(of, Mapping) else field_names(of) or ()
        members = {str(key): of[key] if isinstance(of, Mapping) else getattr(of, key) for key in names}
        if "value" in members:
            # what a run used, or keeps of a device, is no value of it: those are of a type of their own
            if "source" in members:  # stored, of what a run used: it found none of it
                return
            if isinstance(of, Mapping) or not type(of).__module__.startswith("vcfbench."):
                yield from _quantity(name, members)
            return
        for key, each in members.items():
            if name or key not in LIMITED or not (each is None or _number(each) is not None):
                yield from _found(each, f"{name}.{key}" if name else key)
            elif (number := _number(each)) is None:
                yield Unstated(key, LIMITED[key])
            else:
                yield Value(key, number, KINDS[LIMITED[key]].si, kind=LIMITED[key])


def _of_before(results: Mapping[str, Any]) -> Iterator[Value | Unstated]:
    """Yield the values of stored results whose code is not known: those of their statement, then those beside it."""
    statement = results["uncertainty"]
    listed = statement.get("values", ()) if isinstance(statement, Mapping) else ()
    known = {each.name: each for of in listed for each in _quantity(str(of.get("name")), of)}
    yield from known.values()
    yield from (each for each in _found({**results, "uncertainty": None}, "") if each.name not in known)


def _quantity(name: str, members: Mapping[str, Any]) -> Iterator[Value]:
    """Yield each part that has a value, and perhaps a unit and uncertainties, under any names that they ever had."""
    number, unit = _number(members["value"]), str(members.get("unit") or "")
    if number is not None:
        expanded = (_number(members.get(each)) for each in ("u95", "expanded_u", "u_95"))
        parts = [
            UncertaintyPart(str(each["source"]), float(each["u"]))
            for each in plain(members.get("parts") or members.get("contributions") or ())
        ]
        yield Value(
            *(name, number, unit, _number(members.get("u")), _number(members.get("dof"))),
            next((each for each in expanded if each is not None), None),
            kind=kind_of(name, unit),
            of=str(members.get("of") or ""),
            parts=parts,
            missing=tuple(map(str, members.get("missing") or ())),
        )


def _number(value: object) -> float | None:
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None
