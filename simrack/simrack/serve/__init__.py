"""Serves a simulated bench on real wires: raw sockets, VXI-11, HiSLIP, pseudo-terminals, and a control port.

One thread serves everything. The caller builds the bench on a :class:`ServedClock` and hands it over::

    clock = ServedClock(speed=10.0)
    bench = ...                                     # a World and its devices, built on `clock`
    with BenchServer(ServedBench(world, devices, models), clock) as server:
        print(server.as_json())
        server.run()                                # until server.stop()
"""

from simrack.adjustment import Adjustable, Adjustment
from simrack.serve.clock import MAX_SPEED, ServedClock
from simrack.serve.remote import Control, ControlError, RemoteClock
from simrack.serve.server import BenchServer, Offer, Rs232, ServedBench, ServerSettings, Wires

__all__ = [
    "MAX_SPEED",
    "Adjustable",
    "Adjustment",
    "BenchServer",
    "Control",
    "ControlError",
    "Offer",
    "RemoteClock",
    "Rs232",
    "ServedBench",
    "ServedClock",
    "ServerSettings",
    "Wires",
]
