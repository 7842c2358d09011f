"""Calls one method after another of the maker's own library; prints what went wrong with each, as JSON.

What needs an identified device is left out: it asks a server of the maker's. Run by an interpreter that has
zaber-motion; the last word is the resource (``socket://host:port`` or a terminal).
"""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

from zaber_motion import Units
from zaber_motion.ascii import Axis, Connection, Device

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PER_DEG = 640000.0 / 360.0


def opened(resource: str) -> Connection:
    if resource.startswith("socket://"):
        host, _, port = resource.removeprefix("socket://").rpartition(":")
        return Connection.open_tcp(host, int(port))
    return Connection.open_serial_port(resource)


def expect(value: Any, wanted: Any, within: float = 0.0) -> None:
    good = value == wanted if not within else abs(value - wanted) <= within
    if not good:
        raise AssertionError(f"expected {wanted}, got {value}")


def calls(line: Connection, device: Device, axis: Axis) -> Iterator[tuple[str, Callable[[], Any]]]:
    yield "enable_alerts", line.enable_alerts
    yield "detect_devices", lambda: expect(len(line.detect_devices(identify_devices=False)), 1)
    yield "generic_command", lambda: expect(device.generic_command("get deviceid").data, "50081")
    yield "generic_command_multi_response", lambda: device.generic_command_multi_response("get pos")
    yield "generic_command_no_response", lambda: axis.generic_command_no_response("get pos")
    yield "warnings.get_flags", lambda: expect(axis.warnings.get_flags(), set())
    yield "settings.get system.access", lambda: device.settings.get("system.access")
    yield "settings.get system.voltage", lambda: device.settings.get("system.voltage")
    yield "settings.set accel", lambda: axis.settings.set("accel", 60)
    yield "settings.get accel", lambda: expect(axis.settings.get("accel"), 60.0)
    yield "settings.get nonsense", lambda: axis.settings.get("nonsense")
    yield "home", axis.home
    yield "is_homed", lambda: expect(axis.is_homed(), wanted=True)
    yield "move_absolute", lambda: axis.move_absolute(45 * PER_DEG)
    yield "get_position", lambda: expect(axis.get_position(), 45 * PER_DEG, 1.0)
    yield "move_relative", lambda: axis.move_relative(-15 * PER_DEG)
    yield "get_position again", lambda: expect(axis.get_position(Units.NATIVE), 30 * PER_DEG, 1.0)
    yield "move_velocity", lambda: axis.move_velocity(10 * PER_DEG * 1.6384)
    yield "is_busy", lambda: expect(axis.is_busy(), wanted=True)
    yield "park while turning", axis.park
    yield "stop", axis.stop
    yield "is_busy at rest", lambda: expect(axis.is_busy(), wanted=False)
    yield "move_min", axis.move_min
    yield "move_max", axis.move_max
    yield "park", axis.park
    yield "is_parked", lambda: expect(axis.is_parked(), wanted=True)
    yield "move while parked", lambda: axis.move_velocity(1000)
    yield "unpark", axis.unpark
    yield "driver_disable", axis.driver_disable
    yield "move while disabled", lambda: axis.move_velocity(1000)
    yield "driver_enable", axis.driver_enable
    yield "warnings.clear_flags", axis.warnings.clear_flags
    yield "wait_until_idle", axis.wait_until_idle
    yield "all_axes.home", device.all_axes.home
    yield "all_axes.stop", device.all_axes.stop
    yield "renumber", lambda: expect(device.renumber(1).device_address, 1)
    yield "storage", lambda: device.storage.get_string("key")


def main() -> None:
    line = opened(sys.argv[-1])
    device = line.get_device(1)
    seen: dict[str, str | None] = {}
    for name, call in calls(line, device, device.get_axis(1)):
        try:
            call()
        except Exception as error:  # noqa: BLE001  # whatever goes wrong is what is asked for
            seen[name] = f"{type(error).__name__}: {error}"
        else:
            seen[name] = None
    line.close()
    print(json.dumps(seen))  # noqa: T201


if __name__ == "__main__":
    main()
