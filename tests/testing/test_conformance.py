from __future__ import annotations

import dataclasses
from contextlib import suppress
from typing import Any

import pytest

from vcfbench.clock import VirtualClock
from vcfbench.drivers.rate_table.acl import AclDialect
from vcfbench.drivers.rate_table.dialect import TableSettings
from vcfbench.drivers.rate_table.driver import RateTableDriver
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.drivers.session import Session
from vcfbench.drivers.wire import Wire
from vcfbench.errors import BenchError
from vcfbench.interfaces import RateTable, SafeReport, UnprovedCommand
from vcfbench.models import MODELS
from vcfbench.testing import ConformanceCase, conformance_problems, model_case


def _open_table(wire: Wire, clock: VirtualClock) -> RateTableDriver:
    line = TableLine(wire, name="under test", resource="script://", clock=clock, timeout_s=1.0)
    return RateTableDriver(line, AclDialect(TableSettings(reply_header="none")), TableSettings(100.0, 100.0))


_TABLE_CASE = ConformanceCase(
    "acl",
    RateTableDriver,
    RateTable,
    _open_table,
    {
        "*IDN?": "Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a",
        ":Read:Rate?": "0.0",
        ":Status:CSR?": "0",
        ":Interlock?": "Open",
    },
    ":Status:MSG? QERROR",
    ("bad value",),
    "0",
)

CASES = (*map(model_case, MODELS), _TABLE_CASE)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.model)
def test_driver_conforms(case: ConformanceCase) -> None:
    assert conformance_problems(case) == []


def test_every_registered_driver_has_a_case() -> None:
    assert {case.model for case in CASES} == {row.name for row in MODELS} | {"acl"}


def problems_of(**members: object) -> list[str]:
    """Return the problems of an E3631A driver with some members replaced."""
    case = next(case for case in CASES if case.model == "E3631A")
    broken = type("Broken", (case.driver_class,), members)
    return conformance_problems(
        dataclasses.replace(
            case,
            driver_class=broken,
            open_on=lambda wire, clock: broken(
                Session(wire, name="under test", resource="SCRIPT", clock=clock, timeout_s=1.0)
            ),
        )
    )


def test_a_missing_method_is_noticed() -> None:
    assert "enable_outputs is missing" in problems_of(enable_outputs=None)


def test_another_signature_is_noticed() -> None:
    def measure_voltage_v(self: object, output: str, range_v: float) -> float:
        """Measure."""
        del self, output
        return range_v

    assert any("measure_voltage_v is called differently" in p for p in problems_of(measure_voltage_v=measure_voltage_v))


def test_a_driver_that_ignores_refusals_is_noticed() -> None:
    def check_errors(self: object) -> None:
        """Say that all is well."""

    assert any("not an InstrumentError" in problem for problem in problems_of(check_errors=check_errors))


def test_a_safe_action_that_only_says_so_is_noticed() -> None:
    def make_safe(self: object, deadline: object) -> SafeReport:
        """Say that all is well."""
        del self, deadline
        return SafeReport("under test", "SCRIPT", safe=True, detail="trust me")

    assert any("silent, make_safe()" in problem for problem in problems_of(make_safe=make_safe))


def test_driver_without_blind_off_command_is_noticed() -> None:
    def asking(self: Any) -> UnprovedCommand:
        """Ask instead of telling."""
        with suppress(BenchError):
            self.session.query("OUTP?")
        return UnprovedCommand("to switch off", sent=True)

    problems = problems_of(command_safe=asking)
    assert any("well, command_safe() asked" in problem for problem in problems)
    assert any("silent, command_safe() asked" in problem for problem in problems)
    assert any("command_safe() sent nothing" in problem for problem in problems_of(safe_words=()))


def test_missing_words_are_noticed() -> None:
    def close(self):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        pass

    assert {"close has no docstring", "close is not fully annotated"} <= set(problems_of(close=close))
