"""Which instruments of a bench are opened and made safe, how long that may take, and what proves it."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

import vcfbench
from vcfbench.errors import ConfigError, InterlockError
from vcfbench.safety.roles import ROLES, absent, filled_roles, needed_roles, require_still, safe_action
from vcfbench.safety.stack import Stage

PAPER = vcfbench.load_bench("paper")
ROLE = {role.name: role for role in ROLES}


def names(*needs: str) -> list[str]:
    return [role.name for role in needed_roles(PAPER, needs)]


def test_actuators_are_opened_even_if_unneeded() -> None:
    assert names() == ["power", "rate_source", "rate_table"]
    assert names("multimeter", "power") == ["power", "rate_source", "multimeter", "rate_table"]
    everything = ["power", "rate_source", "multimeter", "oscilloscope", "rate_table"]
    assert [role.name for role in needed_roles(PAPER, None)] == everything
    assert [role.name for role in filled_roles(PAPER)] == everything


def test_what_is_needed_and_not_there_is_said() -> None:
    with pytest.raises(ConfigError, match=r"^chamber: bench paper has none; its bench file needs a table \[chamber\]$"):
        needed_roles(PAPER, {"chamber"})
    with pytest.raises(ConfigError, match=r"^chamber: "):
        needed_roles(PAPER, ["power", "chamber"])
    words = (
        "^multimeter: it was not opened, because the procedure does not name it: bench paper; name it in the `needs`"
    )
    with pytest.raises(ConfigError, match=words):
        raise absent("multimeter", PAPER)


def test_table_gets_time_to_come_down() -> None:
    """2 (v / a + the time of its own) above the four exchanges of every instrument."""
    assert PAPER.power is not None
    assert PAPER.rate_table is not None
    fast = replace(
        PAPER,
        power=replace(PAPER.power, timeout_s=1.5),
        rate_table=replace(PAPER.rate_table, timeout_s=0.5),
        limits=replace(PAPER.limits, max_rate_deg_s=300.0),
        procedure_table={**PAPER.procedure_table, "acceleration_deg_s2": 100.0},
    )
    instrument: Any = SimpleNamespace()
    assert safe_action(ROLE["power"], instrument, fast).deadline_s == 6.0
    assert safe_action(ROLE["rate_table"], instrument, fast).deadline_s == 2.0 + 2.0 * 3.0
    slow: Any = SimpleNamespace(own_time_s=4.0)
    action = safe_action(ROLE["rate_table"], slow, fast)
    assert (action.deadline_s, action.stage, action.instrument) == (16.0, Stage.MOTION, slow)


@pytest.mark.parametrize(
    ("role", "read", "on", "off"),
    [
        ("power", "outputs_enabled", (True, "its outputs are on"), False),
        ("rate_source", "output_enabled", (True, "its output is on"), False),
        ("vibration_source", "output_enabled", (True, "its output is on"), False),
        ("chamber", "flow_enabled", (True, "its air flows"), False),
        ("rate_table", "rate_deg_s", (-0.051, "it turns at -0.051 deg/s"), 0.05),
        ("rate_table", "rate_deg_s", (0.051, "it turns at 0.051 deg/s"), -0.05),
    ],
)
def test_each_is_proved_by_what_it_reads_back(role: str, read: str, on: tuple[Any, str], off: Any) -> None:
    def fault(value: Any) -> str | None:
        return ROLE[role].wrong(SimpleNamespace(**{read: lambda: value}))

    assert fault(on[0]) == on[1]
    assert fault(off) is None


def test_table_turning_before_first_command_is_named() -> None:
    def table(rate_deg_s: float) -> Any:
        return SimpleNamespace(rate_deg_s=lambda: rate_deg_s, name="rate_table", resource="COM1")

    require_still(table(0.05))
    words = "^rate_table at COM1: it turns at 12 deg/s before any command was sent; vcfbench stops it; find"
    with pytest.raises(InterlockError, match=words):
        require_still(table(12.0))
