from __future__ import annotations

import pytest

from tests.sim.rate_tables.acl.hosts import AttendedHost, Host


@pytest.fixture
def host() -> Host:
    return Host()


@pytest.fixture
def attended() -> AttendedHost:
    return AttendedHost()
