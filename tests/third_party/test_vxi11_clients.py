"""The VXI-11 of 33220A and DSO7104B, asked by python-vxi11: link, locks, abort, clear, service requests."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.third_party.conftest import Served, command, install

pytestmark = pytest.mark.skipif(sys.version_info >= (3, 13), reason="python-vxi11 0.9 needs xdrlib, which has gone")


@pytest.fixture(scope="session")
def vxi11(shared: Path) -> Path:
    """Interpreter of an environment with python-vxi11."""
    return install(shared, "python-vxi11==0.9")


def port(resource: str) -> str:
    return resource.partition(",")[2].partition("::")[0]


def test_everything_that_python_vxi11_does(vxi11: Path, served: Served) -> None:
    where = [port(served.resource(role, "vxi11")) for role in ("rate_source", "oscilloscope")]
    done = command(vxi11, Path(__file__).parent / "clients" / "vxi11_client.py", *where)
    assert done.returncode == 0, done.stderr[-3000:]
    seen: dict[str, Any] = json.loads(done.stdout)
    assert "33220A" in seen["identity"][0]
    assert "DSO7104B" in seen["identity"][1]
    assert seen["most"] == 16384
    assert seen["frequency"] == pytest.approx(1234.5)
    assert seen["remote"] == [0, 0, None]
    asked = seen["service request"]
    assert {key: asked[key] for key in ("create", "enable", "disable", "destroy")} == dict.fromkeys(
        ("create", "enable", "disable", "destroy"), 0
    )
    assert asked["handle"] == "generator"
    assert [byte & 0x60 for byte in asked["stb"]] == [0x60, 0x20]
    assert asked["error"].startswith("-113")
    assert seen["locks"] == {"locked out": 11, "not locked": 12, "free": None}
    assert seen["cleared"].startswith("+0")
    assert seen["aborted"] == 23
    assert seen["block"][1] == 10 + int(seen["block"][0][2:]) + 1
    assert seen["long write"].startswith("+5000 +0")
