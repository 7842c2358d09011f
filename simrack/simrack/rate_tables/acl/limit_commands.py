"""What the ACUTROL3000 is told and asked about its limits (TM-8004-C 4.6)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec.structs import replace

from simrack.rate_tables.acl.arguments import MODES, Action, Arguments, Query, check_axis, counted, number, word
from simrack.rate_tables.acl.limits import FACTORY, FACTORY_OVERALL, AxisLimits, OverallLimits
from simrack.rate_tables.acl.replies import decimal, listed

if TYPE_CHECKING:
    from simrack.rate_tables.acl.limits import AclLimits
    from simrack.rate_tables.acl.profiler import Profiler

_OF_A_MODE = {
    "Limit:Acceleration": "acceleration_deg_s2",
    "Limit:Rate": "rate_deg_s",
    "Limit:Jerk": "jerk_deg_s3",
}
_OVERALL = {"Limit:Vtrip": "trip_deg_s", "Limit:HighPosition": "high_deg", "Limit:LowPosition": "low_deg"}


class LimitCommands:
    """Limit and all below it; new limits of the present mode act at once."""

    def __init__(self, limits: AclLimits, profiler: Profiler) -> None:
        self._limits = limits
        self._profiler = profiler

    def commands(self) -> dict[str, Action]:
        """Return what can be told about limits."""
        return {
            "Limit": self._set,
            "Limit:Global": self._set_overall,
            **{path: self._setter(name) for path, name in _OF_A_MODE.items()},
            **{path: self._overall_setter(name) for path, name in _OVERALL.items()},
        }

    def queries(self) -> dict[str, Query]:
        """Return what can be asked about limits."""
        return {
            "Limit": self._ask,
            "Limit:Absolute": lambda a: listed(a, *FACTORY.values(), *FACTORY_OVERALL.values()),
            "Limit:Global": lambda a: listed(a, *self._limits.overall.values()),
            **{path: self._asker(name) for path, name in _OF_A_MODE.items()},
            **{path: self._overall_asker(name) for path, name in _OVERALL.items()},
        }

    def _setter(self, name: str) -> Action:
        return lambda arguments: self._set_one(arguments, name)

    def _asker(self, name: str) -> Query:
        return lambda arguments: self._ask_one(arguments, name)

    def _overall_setter(self, name: str) -> Action:
        return lambda arguments: self._set_one_overall(arguments, name)

    def _overall_asker(self, name: str) -> Query:
        return lambda arguments: self._ask_one_overall(arguments, name)

    def _set(self, arguments: Arguments) -> None:
        axis, mode, *values = counted(arguments, 5)
        check_axis((axis,))
        wanted = AxisLimits(*(number(value) for value in values))
        self._change(word(mode, MODES), wanted)

    def _set_one(self, arguments: Arguments, name: str) -> None:
        mode, axis, value = counted(arguments, 3)
        check_axis((axis,))
        mode = word(mode, MODES)
        self._change(mode, replace(self._limits.of(mode), **{name: number(value)}))

    def _change(self, mode: str, wanted: AxisLimits) -> None:
        self._limits.change(mode, wanted)
        if mode == self._profiler.mode:
            self._profiler.follow()

    def _set_one_overall(self, arguments: Arguments, name: str) -> None:
        # the mode is there for Act2000's sake; the ACUTROL3000 has one value for all (TM-8004-C 4.6.4)
        mode, axis, value = counted(arguments, 3)
        word(mode, MODES)
        check_axis((axis,))
        self._limits.change_overall(replace(self._limits.overall, **{name: number(value)}))

    def _set_overall(self, arguments: Arguments) -> None:
        axis, *values = counted(arguments, 5)
        check_axis((axis,))
        self._limits.change_overall(OverallLimits(*(number(value) for value in values)))

    def _ask(self, arguments: Arguments) -> str:
        axis, mode = counted(arguments, 2)
        return listed((axis,), *self._limits.of(word(mode, MODES)).values())

    def _ask_one(self, arguments: Arguments, name: str) -> str:
        mode, axis = counted(arguments, 2)
        check_axis((axis,), everything=False)
        return decimal(getattr(self._limits.of(word(mode, MODES)), name))

    def _ask_one_overall(self, arguments: Arguments, name: str) -> str:
        # the manual's examples ask both "? P,3" and "? 2"
        check_axis(arguments[-1:], everything=False)
        return decimal(getattr(self._limits.overall, name))
