"""Fixtures for tests of drivers: a rack that is served during the tests, and reset before each of them.

A server belongs to a process, so each worker of pytest-xdist has one, on ports of its own. Bench time jumps to whatever
is waited for. What is served says the option `simrack` of pytest's configuration, or a fixture `simrack_instruments`.
"""

from __future__ import annotations

from importlib import import_module
from threading import Thread
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from simrack.serve import BenchServer

_END_S = 30.0


class SimrackFixture:
    """A served rack as a test sees it: resource names by instrument, faults, and the World behind the wires."""

    def __init__(self, server: BenchServer) -> None:
        self._server = server
        self._control = import_module("simrack.serve").Control(server.control.port)

    def __getitem__(self, name: str) -> str:
        """Return the resource name of an instrument that needs the fewest settings: with ends of messages, if any."""
        return self.place(name, next(wire for wire in ("vxi11", "hislip", "pty", "tcp") if self._wires(name)[wire]))

    def place(self, name: str, wire: str) -> str:
        """Return the resource name of an instrument on a wire: vxi11, hislip, pty or tcp."""
        found = self._wires(name).get(wire)
        if found is None:
            raise KeyError(f"{name} is not on {wire!r}")
        return found

    def _wires(self, name: str) -> dict[str, str | None]:
        if name not in self._server.wires:
            raise KeyError(f"there is no {name!r}, only {', '.join(self._server.wires)}")
        return self._server.wires[name].as_json()

    def fault(self, name: str, kind: str, **more: Any) -> None:
        """Start a fault at an instrument now, as of :class:`simrack.faults.Fault`."""
        self._control.request("fault", instrument=name, kind=kind, **more)

    def get(self, name: str) -> Any:
        """Return a quantity behind the wires, by the name that `simrack ctl` lists."""
        return self._control.request("get", name=name)

    def set(self, name: str, value: Any) -> None:
        """Change a quantity behind the wires."""
        self._control.request("set", name=name, value=value)

    def reset(self) -> None:
        """Put everything back to the beginning, without faults; connections stay."""
        self._control.request("clear_faults")
        self._control.request("reset")

    def close(self) -> None:
        """End the connection to the server."""
        self._control.close()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Offer the option `simrack`."""
    parser.addini("simrack", "what is served, as of `simrack serve`", type="args", default=[])


@pytest.fixture(scope="session")
def simrack_instruments(pytestconfig: pytest.Config) -> Sequence[str]:
    """Return the served instruments, as `simrack serve` takes them: files, models and wires."""
    return list(pytestconfig.getini("simrack"))


@pytest.fixture(scope="session")
def simrack_server(simrack_instruments: Sequence[str]) -> Iterator[SimrackFixture]:
    """Serve a rack during the tests, once per process."""
    rack, serve = import_module("simrack.rack"), import_module("simrack.serve")
    clock, plan = serve.ServedClock(float("inf")), import_module("simrack.bench_file").planned(simrack_instruments)
    settings = serve.ServerSettings(only=plan.wires_asked_for(), control_port=0, faults=plan.faults)
    with serve.BenchServer(rack.served(clock, plan), clock, settings) as server:
        thread = Thread(target=server.run, name="simrack", daemon=True)
        thread.start()
        fixture = SimrackFixture(server)
        try:
            yield fixture
        finally:
            fixture.close()
            server.stop()
            thread.join(_END_S)


@pytest.fixture
def simrack(simrack_server: SimrackFixture) -> SimrackFixture:
    """Return the served rack, put back to its beginning."""
    simrack_server.reset()
    return simrack_server
