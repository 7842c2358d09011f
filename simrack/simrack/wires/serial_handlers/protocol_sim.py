"""The handler of ``sim://`` URLs: pyserial looks for a module of this name with a class `Serial`."""

from __future__ import annotations

from simrack.wires.serial_backend import SimulatedSerial

Serial = SimulatedSerial
