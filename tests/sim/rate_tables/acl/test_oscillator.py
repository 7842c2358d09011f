"""SYNTHESIS mode on the World's own table behind an attended clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.sim.rate_tables.acl.hosts import AttendedHost


def extremes(attended: AttendedHost, seconds: float) -> tuple[float, float]:
    """The largest and the smallest true angle of a while."""
    angles = []
    for _ in range(round(seconds / 0.01)):
        attended.wait(0.01)
        angles.append(attended.world.table.angle_deg())
    return max(angles), min(angles)


def test_synthesis_oscillates_about_the_demanded_position(attended: AttendedHost) -> None:
    attended.servo("Position")
    attended.ask(":Demand:Position 1,30;Oscillator 1,10,0.5,0")
    attended.wait(10.0)
    assert attended.ask(":Mode:Synthesis 1") == "OK"
    assert attended.ask(":Status:CSR? A1DYN,10;CSR? A1DYN,11;CSR? A1DYN,9") == "0;1;0"
    attended.wait(2.0)  # 10 deg at 10 deg/s
    highest, lowest = extremes(attended, 4.0)
    # 25 Hz of loop let half a hertz pass as it is
    assert (highest + lowest) / 2 == pytest.approx(30.0, abs=0.1)
    assert (highest - lowest) / 2 == pytest.approx(10.0, rel=2e-3)
    assert attended.ask(":Status:CSR? A1DYN,10") == "1"
    attended.ask(":Mode:Off 1")
    attended.wait(1.0)
    assert attended.world.table.rate_deg_s() == pytest.approx(0.0, abs=1e-6)


def test_changed_demand_slews_amplitude_and_keeps_phase(attended: AttendedHost) -> None:
    attended.servo("Position")
    attended.ask(":Limit:Acceleration S,1,1000")
    attended.ask(":Configure:Oscillator 1,Disable,5,0.1,Pos,Lin;:Demand:Oscillator 1,10,1,0;:Mode:Synthesis 1")
    attended.wait(1.0)
    assert attended.ask(":Status:CSR? A1DYN,10") == "0"
    attended.wait(5.0)
    before = attended.world.table.rate_deg_s(), attended.world.table.angle_deg()
    attended.acl.write(b":Demand:Oscillator 1,4,1,0\n")
    assert (attended.world.table.rate_deg_s(), attended.world.table.angle_deg()) == pytest.approx(before)
    attended.wait(2.0)
    attended.acl.read(100)
    highest, lowest = extremes(attended, 1.0)
    assert (highest - lowest) / 2 == pytest.approx(4.0, rel=5e-3)
    assert attended.ask(":Configure:Oscillator? 1") == "Disable,5.00000,0.10000,Position,Linear"


@pytest.mark.parametrize(("state", "amplitude"), [("Rate", 62.83), ("Accel", 394.8)])
def test_the_amplitude_may_be_of_rate_or_acceleration(attended: AttendedHost, state: str, amplitude: float) -> None:
    """Both are 10 deg at 1 Hz."""
    attended.servo("Position")
    attended.ask(":Limit:Acceleration S,1,1000")
    attended.ask(f":Con:Osc 1,Enable,1000,1,{state},Lin;:Demand:Oscillator 1,{amplitude},1,0;:Mode:Synthesis 1")
    attended.wait(2.0)
    highest, lowest = extremes(attended, 2.0)
    assert (highest - lowest) / 2 == pytest.approx(10.0, rel=3e-3)


@pytest.mark.parametrize("limit", ["Rate S,1,20", "Acceleration S,1,125.66"])
def test_the_limits_of_synthesis_mode_hold(attended: AttendedHost, limit: str) -> None:
    attended.servo("Position")
    attended.ask(f":Limit:Acceleration S,1,4000;{limit};:Demand:Oscillator 1,100,1,0;:Mode:Synthesis 1")
    attended.wait(5.0)
    rates = []
    for _ in range(100):
        attended.wait(0.01)
        rates.append(abs(attended.world.table.rate_deg_s()))
    assert max(rates) == pytest.approx(20.0, rel=3e-3)


def test_a_turning_axis_is_stopped_before_it_oscillates(attended: AttendedHost) -> None:
    attended.servo("Rate")
    attended.ask(":Demand:Rate 1,50")
    attended.wait(2.0)
    attended.ask(":Demand:Oscillator 1,2,1,0;:Mode:Synthesis 1")
    attended.wait(4.0)
    highest, lowest = extremes(attended, 2.0)
    assert (highest - lowest) / 2 == pytest.approx(2.0, rel=5e-3)


@pytest.mark.parametrize("phase", [0, 90])
def test_a_sinusoid_of_frequency_nought_stands_still(attended: AttendedHost, phase: int) -> None:
    attended.servo("Position")
    attended.wait(1.0)
    assert attended.ask(f":Demand:Oscillator 1,5,0,{phase};:Mode:Synthesis 1") == "OK"
    angle = attended.world.table.angle_deg()
    attended.wait(5.0)
    assert attended.world.table.angle_deg() == angle
    assert attended.ask(":Demand:Oscillator 1,5,0.5,0") == "OK"
    attended.wait(3.0)
    highest, lowest = extremes(attended, 4.0)
    assert (highest - lowest) / 2 == pytest.approx(5.0, rel=5e-3)
    assert attended.ask(":Demand:Oscillator 1,5,0,0") == "OK"
    attended.wait(5.0)
    assert attended.world.table.rate_deg_s() == pytest.approx(0.0, abs=1e-9)


def test_axis_shut_down_before_synthesis_does_not_oscillate(attended: AttendedHost) -> None:
    attended.servo("Rate")
    attended.wait(1.0)
    attended.ask(":Limit:Acceleration Abort,1,4000;:Limit:Acceleration Synthesis,1,10")
    attended.ask(":Demand:Rate 1,50;:Demand:Oscillator 1,5,1,0")
    attended.wait(10.0)
    attended.acl.write(b":Mode:Synthesis 1;:Interlock:Open 1\n")
    attended.wait(30.0)
    assert not attended.world.table.servo_closed
    assert attended.world.table.rate_deg_s() == 0.0
