from __future__ import annotations

import math
from unittest.mock import Mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vcfbench.errors import LimitError
from vcfbench.station.limits import (
    LimitChecks,
    LimitedChamber,
    LimitedGenerator,
    LimitedRateTable,
    LimitedSupply,
    driver_of,
)
from vcfbench.station.parts import Limits, RailWiring

LIMITS = Limits(
    max_rate_deg_s=300.0,
    max_acceleration_deg_s2=200.0,
    max_v_vc_v=5.0,
    min_rail_v=9.0,
    max_rail_v=11.0,
    max_rail_current_a=0.2,
)
CHECKS = LimitChecks(LIMITS, RailWiring())


def driver(name: str) -> Mock:
    made = Mock(resource="FAKE::1")
    made.name = name
    return made


ANY = st.floats() | st.sampled_from([300.0, 200.0, -300.0, 0.0, 0.5, -5.0])


@given(ANY, ANY)
def test_table_gets_only_commands_within_limits(rate: float, acceleration: float) -> None:
    table = driver("rate_table")
    allowed = abs(rate) <= 300.0 and 0.0 < acceleration <= 200.0
    try:
        LimitedRateTable(table, CHECKS).set_rate(rate, acceleration)
    except LimitError:
        assert not allowed
        table.set_rate.assert_not_called()
    else:
        assert allowed
        table.set_rate.assert_called_once_with(rate, acceleration)


def test_a_refusal_says_instrument_limit_and_unit() -> None:
    with pytest.raises(LimitError) as caught:
        LimitedRateTable(driver("rate_table"), CHECKS).set_rate(-301.0, 100.0)
    said = "rate_table at FAKE::1: rate -301 deg/s is beyond the bench's limit of 300 deg/s; nothing was sent"
    assert str(caught.value) == said


@given(ANY)
def test_stop_needs_acceleration_that_can_stop_table(acceleration: float) -> None:
    table = driver("rate_table")
    try:
        LimitedRateTable(table, CHECKS).stop(acceleration)
    except LimitError as error:
        assert not 0.0 < acceleration <= 200.0
        assert str(error).startswith("rate_table at FAKE::1: acceleration ")  # noqa: PT017  # either outcome is right
        table.stop.assert_not_called()
    else:
        assert 0.0 < acceleration <= 200.0
        table.stop.assert_called_once_with(acceleration)


@given(ANY)
def test_the_generator_stays_within_v_vc(voltage: float) -> None:
    generator = driver("rate_source")
    limited = LimitedGenerator(generator, CHECKS)
    for method, sent in ((limited.configure_dc, generator.configure_dc), (limited.set_dc, generator.set_dc)):
        try:
            level_v = method(voltage)
        except LimitError:
            assert not abs(voltage) <= 5.0
            sent.assert_not_called()
        else:
            assert abs(voltage) <= 5.0
            assert level_v is sent.return_value
            sent.assert_called_once_with(voltage)


def test_the_peak_of_a_sine_counts_with_its_offset() -> None:
    generator = driver("rate_source")
    LimitedGenerator(generator, CHECKS).configure_sine(10.0, 4.0, -3.0)
    with pytest.raises(LimitError, match=r"peak voltage 5\.05 V is beyond the bench's limit of 5 V"):
        LimitedGenerator(generator, CHECKS).configure_sine(10.0, 4.1, -3.0)
    generator.configure_sine.assert_called_once_with(10.0, 4.0, -3.0)


def test_a_sine_is_around_0_v_where_nothing_is_said() -> None:
    generator = driver("rate_source")
    LimitedGenerator(generator, CHECKS).configure_sine(10.0, 4.0)
    generator.configure_sine.assert_called_once_with(10.0, 4.0, 0.0)


@pytest.mark.parametrize(
    ("output", "voltage", "current", "words"),
    [
        ("P25V", 11.1, 0.1, r"P25V 11.1 V is outside the bench's rail window of 9 to 11 V"),
        ("P25V", -10.0, 0.1, r"rail window of 9 to 11 V"),
        ("P25V", 8.9, 0.1, r"rail window"),
        ("N25V", 10.0, 0.1, r"rail window of -11 to -9 V"),
        ("P6V", 5.0, 0.1, r"feeds no rail"),
        ("P25V", math.nan, 0.1, r"rail window"),
        ("P25V", 10.0, 0.21, r"current limit 0.21 A is beyond the bench's limit of 0.2 A"),
        ("P25V", 0.0, 0.21, r"current limit"),
        ("P25V", 10.0, math.nan, r"current limit"),
    ],
)
def test_the_supply_refuses_what_the_rails_do_not_bear(output: str, voltage: float, current: float, words: str) -> None:
    supply = driver("power")
    with pytest.raises(LimitError, match=words):
        LimitedSupply(supply, CHECKS).configure_output(output, voltage, current)
    supply.configure_output.assert_not_called()


@pytest.mark.parametrize(
    "setting",
    [
        *(("P25V", 10.0, 0.2), ("N25V", -10.0, 0.1), ("P6V", 0.0, 0.0), ("N25V", 0.0, 0.1)),
        *(("P25V", 9.0, 0.2), ("P25V", 11.0, 0.2), ("N25V", -9.0, 0.2), ("N25V", -11.0, 0.2)),
    ],
)
def test_the_supply_gets_what_the_rails_bear(setting: tuple[str, float, float]) -> None:
    supply = driver("power")
    LimitedSupply(supply, CHECKS).configure_output(*setting)
    supply.configure_output.assert_called_once_with(*setting)


@pytest.mark.parametrize(
    ("temperature_c", "ramp_k_min", "words"),
    [
        *((-40.0, 600.0, ""), (85.0, 0.5, ""), (20.0, 1e-3, "")),
        *((-40.1, 1.0, "outside the bench's -40 to 85 degC"), (85.1, 1.0, "outside"), (math.nan, 1.0, "outside")),
        *((20.0, 600.1, "ramp 600.1 K/min is beyond"), (20.0, math.nan, "beyond")),
        *((20.0, 0.0, "ramp 0 K/min is not above 0"), (20.0, -1.0, "not above 0")),
    ],
)
def test_the_chamber_stays_within_its_temperatures_and_its_ramp(
    temperature_c: float, ramp_k_min: float, words: str
) -> None:
    checks = LimitChecks(Limits(min_temperature_c=-40.0, max_temperature_c=85.0, max_ramp_k_min=600.0), RailWiring())
    if not words:
        checks.temperature(temperature_c, ramp_k_min)
        return
    with pytest.raises(LimitError, match=words):
        checks.temperature(temperature_c, ramp_k_min)


def test_chamber_gets_only_setpoints_within_limits() -> None:
    chamber = driver("chamber")
    limits = Limits(min_temperature_c=-40.0, max_temperature_c=85.0, max_ramp_k_min=2.0)
    limited = LimitedChamber(chamber, LimitChecks(limits, RailWiring()))
    assert limited.set_temperature(20.0, 1.0) is chamber.set_temperature.return_value
    with pytest.raises(LimitError, match=r"^chamber at FAKE::1: temperature 86 degC is outside"):
        limited.set_temperature(86.0, 1.0)
    chamber.set_temperature.assert_called_once_with(20.0, 1.0)


def test_no_setting_passes_by_the_limits() -> None:
    """Members that set a value are compared with a limit here, but for the window of a settled temperature."""
    kinds = (LimitedRateTable, LimitedChamber, LimitedGenerator, LimitedSupply)
    passed_on = {name for kind in kinds for name, member in vars(kind).items() if isinstance(member, property)}
    setting = {name for name in passed_on if name.startswith(("set_", "configure_"))}
    assert setting == {"set_settled"}
    assert {"enable", "disable", "make_safe", "command_safe", "name", "resource"} <= passed_on


def test_who_judges_messages_itself_finds_the_driver_behind() -> None:
    supply = driver("power")
    assert driver_of(LimitedSupply(supply, CHECKS)) is driver_of(supply) is supply


def test_what_no_protocol_has_is_not_passed_on() -> None:
    limited = LimitedSupply(Mock(spec=["apply"]), CHECKS)
    assert not hasattr(limited, "apply")
