"""Run in InstrumentKit's environment: every property and method of its ESP301; prints what went wrong as JSON."""

from __future__ import annotations

import json
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from instruments.newport import NewportESP301
from instruments.newport.errors import NewportError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


def magnitude(value: Any) -> float:
    return float(getattr(value, "magnitude", value))


def calls(controller: NewportESP301) -> Iterator[tuple[str, Callable[[], Any]]]:
    axis = controller.axis[0]
    yield "enable", axis.enable
    for name in sorted(vars(type(axis))):
        found = getattr(type(axis), name)
        if isinstance(found, property) and name not in {"home", "axis_id"}:
            yield name, lambda name=name: getattr(axis, name)
            if found.fset is not None:
                yield f"{name} = as read", lambda name=name: setattr(axis, name, getattr(axis, name))
    yield "home = 0", lambda: setattr(axis, "home", 0)
    yield "home", lambda: axis.home
    yield "read_setup", axis.read_setup
    yield "move", lambda: axis.move(15, wait=True, block=True)
    yield "position after it", lambda: near(axis.position, 15.0)
    yield "move by", lambda: axis.move(-5, absolute=False)
    yield "wait_for_stop", axis.wait_for_stop
    yield "position by it", lambda: near(axis.position, 10.0)
    yield "wait_for_position", lambda: axis.wait_for_position(10)
    yield "wait_for_motion", lambda: axis.wait_for_motion(max_wait=2)
    yield "search_for_home", axis.search_for_home
    yield "is_motion_done", lambda: axis.is_motion_done
    yield "move_indefinitely", axis.move_indefinitely
    yield "move_to_hardware_limit", axis.move_to_hardware_limit
    yield "stop_motion", axis.stop_motion
    yield "abort_motion", axis.abort_motion
    yield "disable", axis.disable
    yield "reset", controller.reset


def near(got: Any, wanted: float) -> None:
    if abs(magnitude(got) - wanted) > 1e-3:
        raise AssertionError(f"expected {wanted}, got {got}")


def attempt(controller: NewportESP301, call: Callable[[], Any]) -> str | None:
    try:
        call()
    except Exception as error:  # noqa: BLE001  # whatever goes wrong is what is asked for
        words = f"{type(error).__name__}: {getattr(error, 'errcode', error)}"
        for _ in range(10):
            with suppress(NewportError, OSError):  # what is left in its queue
                controller._newport_cmd("SN?", target=1)
        return words
    return None


def main() -> None:
    host, _, port = sys.argv[-1].removeprefix("socket://").rpartition(":")
    controller = NewportESP301.open_tcpip(host, int(port))
    controller._file.timeout = 3
    sys.stdout.write(json.dumps({name: attempt(controller, call) for name, call in calls(controller)}) + "\n")


if __name__ == "__main__":
    main()
