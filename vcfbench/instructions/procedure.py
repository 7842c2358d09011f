"""A procedure as one object: the source of its command, its settings in the bench file, its record."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Generic, Literal, TypeVar

from msgspec import Struct, field
from msgspec.structs import force_setattr

from vcfbench.arguments import require_types
from vcfbench.errors import ConfigError
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.interfaces import ForcesTemperature, MeasuresWaveforms, PowersRails, ReadsVoltage, Rotates, SetsVoltage
from vcfbench.models import ROLES
from vcfbench.reports.generic import generic_report
from vcfbench.station.layering import require_defaults
from vcfbench.station.settings import ProcedureSettings

if TYPE_CHECKING:
    from collections.abc import Iterable
    from datetime import datetime

    from vcfbench.records.devices import NewEntry
    from vcfbench.reports.document import Report
    from vcfbench.station.acceptance import Acceptance
    from vcfbench.steps.measured import Measured
    from vcfbench.steps.step import Plan, Step

_TYPES: Mapping[str, Any] = MappingProxyType(
    {
        **dict.fromkeys(("name", "title", "method", "in_one_piece"), str),
        **dict.fromkeys(("plan", "results", "report"), Callable),
        **dict.fromkeys(("entry", "in_turn"), Callable | None),
        **dict.fromkeys(("streams", "several"), bool),
        "unforeseen": Mapping,
    }
)

S = TypeVar("S", bound=ProcedureSettings)
R = TypeVar("R")

_USUAL: Mapping[str, type] = MappingProxyType(
    {
        "power": PowersRails,
        "rate_source": SetsVoltage,
        "multimeter": ReadsVoltage,
        "rate_table": Rotates,
        "oscilloscope": MeasuresWaveforms,
        "v_vc_meter": ReadsVoltage,
        "chamber": ForcesTemperature,
    }
)


def roles(*usual: str, **others: type) -> Mapping[str, type]:
    """Return roles with the capability that procedures usually ask of each, and `others` with one of their own."""
    return MappingProxyType({**{role: _USUAL[role] for role in usual}, **others})


PAPER_NEEDS = roles("rate_source", "multimeter", "rate_table")
"""Roles that the calibrations of the paper need, each with the necessary capability."""

PAPER_USES = roles("power", "oscilloscope")
"""The supply, without which the device feeds itself, and what looks at the drive signal; a run says what is missing."""


class Watched(Struct, frozen=True):
    """Windows of a plan that are compared with each other (`shared.steady.jumps.watched`).

    `steps` are the numbers of their points, None all; with each step of the kind `anew` they begin anew.
    """

    steps: frozenset[int] | None = None
    anew: type[Step] | None = None


class Procedure(Struct, Generic[S, R], frozen=True, kw_only=True):
    """One calibration: its name, settings, plan, results, report and the roles it needs.

    Args:
        name: of its command, of its table in the bench file and in its records: ``turntable``.
        title: one line, the help of its command; those that come along have it by their names.
        method: what is done, in some sentences for the reader of a report; empty: the title says it.
        settings: the class of its settings, each with its range and its default.
        plan: makes the plan, a generator of steps, from the settings.
        results: makes the results from settings and what was measured (the points, a sequence, with all else that the
            journal keeps); pure, so that a record gives the same results again. Any frozen dataclass or msgspec
            struct will do: its fields are what is written.
        report: makes the report from settings, what was measured and results; without it points and fields of the
            results.
        needs: the roles that must be on the bench, and what the instrument in each must be able to do.
        either: the roles of which one must be on the bench, likewise; none: it asks for no such choice.
        uses: the roles that it makes use of where the bench has them, likewise; what looks at no drive signal uses {}.
        entry: makes what is kept of the device that was measured, None where none was named: it is added to the device
            store when the run is complete, recorded and safe.
        unforeseen: results whose U95 no dry run can expect, and why, by the last part of their names.
        watched: the windows that its plan holds against each other; None: nothing of a fault between them is seen.
        in_turn: what its records of the oscilloscope showed in turn, which its results hold against each other.
        streams: whether its output may be a stream of numbers, not a voltage.
        several: whether several devices can be measured together: their plans must be the same.
        in_one_piece: why a run that was broken off cannot be resumed; empty: it can.

    >>> turntable = vcfbench.PROCEDURES["turntable"]
    >>> turntable.title, sorted(turntable.needs)
    ('Calibrate on the rate table, generator off.', ['multimeter', 'rate_table'])
    """

    name: str
    title: str = ""
    settings: type[S]
    plan: Callable[[S], Plan]
    results: Callable[[S, Measured], R]
    report: Callable[[S, Measured, R], Report] = generic_report
    needs: Mapping[str, type] = field(default_factory=lambda: PAPER_NEEDS)
    either: Mapping[str, type] = field(default_factory=lambda: MappingProxyType({}))
    uses: Mapping[str, type] = field(default_factory=lambda: PAPER_USES)
    entry: Callable[[S, R, Provenance], NewEntry | None] | None = None
    unforeseen: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    watched: Watched | None = None
    in_turn: Callable[[S, Measured], Iterable[Any]] | None = None
    in_one_piece: str = ""
    streams: bool = False
    several: bool = False
    method: str = ""

    def __post_init__(self) -> None:
        """Refuse a name that no table of the bench file or no record can have, and settings of another kind."""
        require_types(self, f"procedure {self.name!r}", _TYPES)
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}", self.name):
            raise ConfigError(f"expected a procedure's name of letters, digits, '-' and '_', got {self.name!r}")
        force_setattr(self, "title", self.title or BUILT_IN.get(self.name, ""))
        if not self.title:
            raise ConfigError(f"procedure {self.name!r}: give a title of one line")
        if not isinstance(self.settings, type) or not issubclass(self.settings, ProcedureSettings):
            raise ConfigError(f"procedure {self.name!r}: expected settings that are ProcedureSettings, a class of them")
        require_defaults(self.settings, f"procedure {self.name!r}: ")
        for asked, what in ((self.needs, "needs"), (self.either, "either"), (self.uses, "uses")):
            # Refuse unknown roles and capabilities: else they would fail with the bench
            roles = (*ROLES, "rate_table")
            words = f"procedure {self.name!r}: {what}: expected a capability by role, as in {{'power': PowersRails}}"
            if not isinstance(asked, Mapping):
                raise ConfigError(f"{words}, got {asked!r}")
            for role, capability in asked.items():
                if role not in roles:
                    raise ConfigError(f"{words}, of {', '.join(roles)}; got {role!r}")
                if not isinstance(capability, type):
                    raise ConfigError(f"{words}, got {role}: {capability!r}")
        if self.name in self.settings.__struct_fields__:
            raise ConfigError(
                f"procedure {self.name!r}: its name is that of a setting, [procedure.{self.name}] is both"
            )

    def __repr__(self) -> str:
        return f"<Procedure {self.name}>"


class Provenance(Struct, frozen=True):
    """Origin of results, for the device store."""

    bench: str
    run: str
    simulated: bool
    instruments: Mapping[str, str]
    """Measuring instruments by role: maker, model, serial number and firmware as they answered."""
    finished: datetime
    verdict: Literal["pass", "marginal", "fail"] | None
    """Verdict on the acceptance limits, None where nothing was judged."""

    @classmethod
    def of(cls, header: Mapping[str, Any], run: str, finished: datetime, verdict: Acceptance | None) -> Provenance:
        """Return it by the header of the record called `run`."""
        answered = {
            role: [str(identity.get(name) or "") for name in ("maker", "model", "serial", "firmware")]
            for role, identity in header.get("identities", {}).items()
        }
        return cls(
            bench=str(header["bench"].get("name")),
            run=run,
            simulated=bool(header.get("simulated")),
            instruments={
                role: ",".join(fields) if any(fields) else "has no description" for role, fields in answered.items()
            },
            finished=finished,
            verdict=None if verdict is None else verdict.word,
        )


AnyProcedure = Procedure[Any, Any]
"""A procedure of whatever settings and results."""
