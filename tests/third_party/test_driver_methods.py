"""Every method of drivers from elsewhere, one by one over TCP, the error queue read after each."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.third_party.conftest import Served, command, expected_failures

CLIENTS = Path(__file__).parent / "clients"


def methods(python: Path, client: str, name: str, resource: str) -> dict[str, str | None]:
    """Run a client; return what went wrong for every method, None where nothing did."""
    done = command(python, CLIENTS / client, name, resource)
    assert done.returncode == 0, done.stderr[-3000:]
    return dict(json.loads(done.stdout.splitlines()[-1]))


def check(seen: dict[str, str | None], suite: str, at_least: int) -> None:
    failed = {name: words for name, words in seen.items() if words is not None}
    assert len(seen) >= at_least
    assert set(failed) == set(expected_failures(suite)), failed


@pytest.mark.parametrize(
    ("role", "driver", "at_least"),
    [("rate_source", "Agilent33220A", 45), ("power", "KeysightE3631A", 25), ("multimeter", "HP34401A", 30)],
)
def test_pymeasure(role: str, driver: str, at_least: int, pymeasure: Path, served: Served) -> None:
    seen = methods(pymeasure, "pymeasure_methods.py", driver, served.resource(role, "tcp"))
    check(seen, f"pymeasure.{driver}", at_least)


def test_qcodes(qcodes: Path, served: Served) -> None:
    seen = methods(qcodes, "qcodes_methods.py", "Agilent34401A", served.resource("multimeter", "tcp"))
    check(seen, "qcodes.Agilent34401A", 12)
