from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.sim.rate_tables.acl.hosts import Host


@pytest.mark.parametrize(
    "command",
    [
        ":Demand:Rate 2,10",
        ":Demand:Rate 1",
        ":Demand:Rate 1,ten",
        ":Demand:Rate 1,inf",
        ":Limit:Rate R,1,1000.1",
        ":Limit:Acceleration R,1,-1",
        ":Limit:Acceleration X,1,1",
        ":Limit:Vtrip R,1,1201",
        ":Read:Rate? ALL",
        ":Status:CSR? A1DYN,16",
        ":Status:CSR? NOPE",
        ":Mode 1,Abort",
    ],
)
def test_what_is_out_of_range_is_refused_and_changes_nothing(host: Host, command: str) -> None:
    before = host.ask(":Demand:Rate? 1;:Limit:Rate? R,1;Acceleration? R,1;Vtrip? R,1;:Mode? 1")
    assert host.ask(command) == ""
    assert host.ask(":Demand:Rate? 1;:Limit:Rate? R,1;Acceleration? R,1;Vtrip? R,1;:Mode? 1") == before
    assert host.ask(":Status:STB?") == "128"
    assert host.ask(":Status:MSG? QERROR").startswith("2,PARAMETER OUT OF RANGE,")
