"""The journal of one of several devices: its own lines of the one journal of their run."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from vcfbench.errors import ConfigError
from vcfbench.steps.decode import step_of
from vcfbench.steps.each import DeviceEnded, EachOf, EndedStep

_EACH, _ENDED = EachOf.__name__, DeviceEnded.__name__
NOT_OF_DEVICES = frozenset({"header", "footer", "signature", "amendment"})
_COUNTED = frozenset({"step", "error"})


def projected(lines: Iterable[Mapping[str, Any]], device: str) -> Iterator[dict[str, Any]]:
    """Yield the lines between header and footer for the record of `device` alone.

    Steps of all are its own too, of a step of each its own stands there; where it ended for itself they end. `n` counts
    anew: for others it may have waited.

    Raises:
        ConfigError: a step of each is not known here.
    """
    number, chunks = 0, 0
    for line in lines:
        kind = line.get("type")
        if kind in NOT_OF_DEVICES:
            continue
        own = {key: value for key, value in line.items() if key not in {"seal", "points", "device", "of_devices"}}
        if line.get("step_kind") == _ENDED and kind == "step":
            if line["step"]["device"] == device:
                return
            continue
        if line.get("step_kind") == _EACH:
            if device not in line["step"]["steps"] or line.get("device", device) != device:
                continue
            chunks += kind == "readings"
            own |= _own_step(line, device, chunks)
            own = {key: value for key, value in own.items() if value is not None}
        number += kind in _COUNTED
        own["n"] = number + (kind == "readings")
        chunks = 0 if kind in _COUNTED else chunks
        yield own


def ending(line: Mapping[str, Any]) -> dict[str, EndedStep]:
    """Return the end of a device for itself, by its name, where this line is that."""
    if line.get("type") != "step" or line["step_kind"] != _ENDED:
        return {}
    return {line["step"]["device"]: EndedStep(line["step"]["kind"], line["step"]["what"])}


def _own_step(line: Mapping[str, Any], device: str, chunks: int) -> dict[str, Any]:
    """Return a device's own fields in the line of a step of each, None for those that its line has not.

    `chunks` of its readings came before, or with this line.
    """
    step = step_of(line)
    if not isinstance(step, EachOf):
        raise ConfigError(f"step {line['n']} of the record: its form is not known here")
    mine = step.steps[device]
    own: dict[str, Any] = {"key": mine.key, "step_kind": step.kind, "step": line["step"]["steps"][device]}
    if line["type"] == "readings":
        return own | {"chunk": chunks}
    said = (each.partition(": ") for each in line.get("asked_again", ()))
    own |= {"chunks": chunks or None, "asked_again": [words for name, _, words in said if name == device] or None}
    if line["type"] == "error":
        kind, said = line.get("of_devices", {}).get(device, (line["error_kind"], line["error"]))
        return own | {"error_kind": kind, "error": said}
    result = line["result"]
    if (ended := result["ended"].get(device)) is None:
        own |= {"result_kind": result["kind"], "result": result["results"][device]}
        return own | {"point": line.get("points", {}).get(device)}
    own |= {"result": None, "result_kind": None, "end_s": None, "type": "error", "t_s": line["end_s"]}
    return own | {"error_kind": ended["kind"], "error": ended["what"], "readings": ended["readings"]}
