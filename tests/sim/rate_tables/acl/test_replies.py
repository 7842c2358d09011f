from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tests.sim.rate_tables.acl.hosts import Host


def test_binary_format_sends_scaled_integers(host: Host) -> None:
    host.ask(":Demand:Rate 1,-11250;:Utility:Format BINARY")
    assert host.raw(":Demand:Rate? 1") == b"#14\x00\x00\x00\x80\r\n"
