"""Devices with faults, around the instruments of a bench in one process."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any

from simrack.bench_faults import begin_on_bench, require_possible
from simrack.clock import Clock
from simrack.device import Device
from simrack.faults import AT_ONCE, CUTTING, UNREACHABLE, Fault, FaultScript, Ongoing, spoiled, spoils
from simrack.scpi import ScpiError

_WHOLE = 1 << 25


class FaultyDevice:
    """A device, and its faults.

    Args:
        device: what it stands around.
        clock: bench time.
        noise: where noise comes from.
    """

    def __init__(self, device: Device, clock: Clock, noise: random.Random) -> None:
        self.device = device
        self._clock = clock
        self._noise = noise
        self._planned: list[Fault] = []
        self._active: list[Ongoing] = []
        self._underway: deque[tuple[float, bytes, bool]] = deque()
        self._cut = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self.device, name)

    def add(self, fault: Fault) -> None:
        """Start `fault` at its time, or now if that has passed.

        Raises:
            ValueError: the instrument cannot suffer it.
        """
        require_possible(self.device, fault)
        self._planned.append(fault)
        self._planned.sort(key=lambda each: each.at_s)
        self._advance()

    def clear_faults(self) -> None:
        """End the faults under way and forget the planned ones."""
        self._planned.clear()
        while self._active:
            self._active.pop().undo()
        self._cut = False

    # --- what transports call -------------------------------------------------------------------------------------

    def write(self, data: bytes, *, end: bool = False) -> None:
        """Take bytes from the controller; ConnectionResetError when the link is lost."""
        self._require_link()
        if not self._dead:
            self.device.write(data, end=end)

    def read(self, limit: int) -> tuple[bytes, bool]:
        """Return the bytes that have arrived; ConnectionResetError when the link is lost."""
        self._advance()
        if not (self._active or self._underway or self._cut):
            return self.device.read(limit)
        self._require_link()
        if self._dead:
            return b"", False
        if not self._underway:
            return self.device.read(limit) if not self._spoiling() else (b"", False)
        arrives_s, data, end = self._underway[0]
        if arrives_s > self._clock.now():
            return b"", False
        part, rest = data[:limit], data[limit:]
        if rest:
            self._underway[0] = (arrives_s, rest, end)
        else:
            self._underway.popleft()
        return part, end and not rest

    def wake_at(self) -> float | None:
        """Do everything due; return when something next happens by itself."""
        if not (self._planned or self._active or self._underway):  # as nearly always
            return self.device.wake_at()
        self._advance()
        own = self.device.wake_at()
        if not (self._active or self._underway):
            planned = [each.at_s for each in self._planned[:1]]
            return min([*planned, own] if own is not None else planned, default=None)
        if own is not None and own <= self._clock.now() and self._dead:  # what it says there nobody hears
            own = None
        coming = [
            own,
            *(each.ends_s for each in self._active),
            *(each.at_s for each in self._planned[:1]),
        ]
        coming += [arrives_s for arrives_s, _, _ in self._underway]
        return min((instant for instant in coming if instant is not None), default=None)

    def clear(self) -> None:
        """Device clear."""
        self._require_link()
        self._underway.clear()
        self.device.clear()

    def status_byte(self) -> int:
        """Serial poll."""
        self._require_link()
        return self.device.status_byte()

    def trigger(self) -> None:
        """Group execute trigger."""
        self._require_link()
        self.device.trigger()

    # --- faults ---------------------------------------------------------------------------------------------------

    def _advance(self) -> None:
        """Begin and end faults that are due, and spoil the answers of the device.

        What it says while earlier words are under way comes after them, whether or not the fault is over.
        """
        if not (self._planned or self._active or self._underway):
            return
        now = self._clock.now()
        if not (self._active or self._underway) and self._planned[0].at_s > now:
            return
        while self._planned and self._planned[0].at_s <= now:
            self._begin(self._planned.pop(0))
        self._end([each for each in self._active if each.ends_s is not None and each.ends_s <= now])
        if self._underway or self._spoiling():
            self._spoil_what_is_said()

    def _begin(self, fault: Fault) -> None:
        if fault.kind == "error":
            self.device.engine.report(ScpiError(fault.number))  # type: ignore[attr-defined]  # add() has seen to it
        if fault.kind in CUTTING:
            self._underway.clear()
            self.device.clear()
            self._cut = fault.kind != "unreachable"
        if fault.kind in AT_ONCE:
            return
        undo = begin_on_bench(self.device, fault)
        if fault.kind == "power_cycle" and fault.duration_s is None:
            return
        ends_s = None if fault.duration_s is None else max(fault.at_s, self._clock.now()) + fault.duration_s
        self._active.append(Ongoing(fault, undo, ends_s, fault.count))

    def _end(self, over: Iterable[Ongoing]) -> None:
        for each in over:
            self._active.remove(each)
            each.undo()

    @property
    def _dead(self) -> bool:
        return any(each.fault.kind == "half_open" for each in self._active)

    def _require_link(self) -> None:
        self._advance()
        if self._cut or any(each.fault.kind in UNREACHABLE for each in self._active):
            self._cut = False
            raise ConnectionResetError("the link to the instrument is lost")

    def _spoiling(self) -> list[Ongoing]:
        return [each for each in self._active if spoils(each.fault)]

    def _spoil_what_is_said(self) -> None:
        data, end = self.device.read(_WHOLE)
        if not data:
            return
        arrives_s = max([self._clock.now(), *(each[0] for each in self._underway)])
        spoiling = self._spoiling()
        data, end, late_s = spoiled(spoiling, self._noise, data, end=end)
        self._end([each for each in spoiling if each.over])
        arrives_s += late_s
        if data:
            self._underway.append((arrives_s, data, end))


class FaultInjector:
    """The instruments of a bench, and their faults; `devices` replace the original ones."""

    def __init__(self, devices: Mapping[str, Device], clock: Clock, seed: int = 0) -> None:
        self._clock = clock
        self.devices = {
            role: FaultyDevice(device, clock, random.Random(f"{seed}/{role}"))  # noqa: S311  # noise, not secrets
            for role, device in devices.items()
        }

    def add(self, *faults: Fault) -> None:
        """Start `faults` at their times.

        Raises:
            ValueError: the bench has no such instrument, or the instrument cannot suffer that.
        """
        for fault in faults:
            self._device(fault.instrument).add(fault)

    def play(self, script: FaultScript) -> None:
        """Start all faults of `script`, with noise from its seed; errors as of :meth:`add`."""
        for role, device in self.devices.items():
            device._noise.seed(f"{script.seed}/{role}")  # noqa: SLF001  # its own
        self.add(*script.faults)

    def clear(self, roles: Iterable[str] | None = None) -> None:
        """End the faults of `roles`, or of all, and forget those that are planned."""
        for role in self.devices if roles is None else roles:
            self._device(role).clear_faults()

    def _device(self, role: str) -> FaultyDevice:
        try:
            return self.devices[role]
        except KeyError:
            raise ValueError(f"the bench has no {role!r}, only {', '.join(self.devices)}") from None
