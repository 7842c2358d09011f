from __future__ import annotations

import math

import pytest
from simrack.rate_tables.acl import TableErrors

from tests.sim.rate_tables.acl.hosts import Host


def test_the_encoder_error_shows_in_position_and_rate() -> None:
    host = Host(
        TableErrors(encoder_error_deg=0.01, encoder_phase_deg=0.0, angle_resolution_deg=0, rate_resolution_deg_s=0)
    )
    host.servo()
    host.ask(":Demand:Rate 1,90")
    host.wait(2.0)
    true_angle = host.world.table.angle_deg()
    host.table.write(b":Read:Pos? 1;Rate? 1\n")
    host.wait(0.5)
    angle, rate = (float(text) for text in host.table.read(100)[0].split(b";"))
    assert angle == pytest.approx((true_angle + 0.01 * math.sin(math.radians(true_angle))) % 360, abs=5.1e-6)
    assert rate == pytest.approx(90 * (1 + math.radians(0.01) * math.cos(math.radians(true_angle))), abs=5.1e-6)
