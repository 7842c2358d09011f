from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.sim.rate_tables.acl.hosts import Host


def test_limits_read_back_in_one_message_as_the_manual_shows(host: Host) -> None:
    host.ask(":LIM:H P,1,180.0;L P,1,-180.0;R P,1,100.0;A P,1,2000.0")
    assert host.ask(":LIM:H? P,1;L? P,1;R? P,1;A? P,1") == "180.00000;-180.00000;100.00000;2000.00000"
