"""The records and devices of a station, as its page lists them."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

import msgspec

from vcfbench.errors import BenchError
from vcfbench.record.devices import Certificate, DeviceStore
from vcfbench.record.directory import RunDirectory
from vcfbench.record.journal import being_written, read_header
from vcfbench.record.outline import outline_of

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from vcfbench.record.devices import Entry

__all__ = ["Station"]

_MOST_RUNS: Final = 500
_KEY_VALUES: Final = 3
_LONGEST_RESULT: Final = 1 << 24


class Station:
    """What the directories of a station hold; a record that is complete is read once."""

    def __init__(self, runs: Path, devices: Path) -> None:
        self._runs, self._devices = runs, devices
        self._known: dict[str, tuple[int, dict[str, Any]]] = {}

    def listed(self) -> dict[str, Any]:
        """Return the latest runs, newest first, and the devices."""
        names = self._names()
        rows = [self._row(RunDirectory(self._runs / name)) for name in names[:_MOST_RUNS]]
        return {
            "runs": sorted(rows, key=lambda row: str(row.get("began_utc") or row["run"]), reverse=True),
            "older": max(0, len(names) - _MOST_RUNS),
            "devices": self._device_rows(),
        }

    def directory(self, name: str) -> RunDirectory | None:
        """Return the run of that very name; None where there is none."""
        if name not in self._names():
            return None
        directory = RunDirectory(self._runs / name)
        return directory if directory.journal.is_file() else None

    def _names(self) -> list[str]:
        """Return the names of the runs, the latest first: they begin with the time."""
        try:
            return sorted((each.name for each in self._runs.iterdir() if each.is_dir()), reverse=True)
        except OSError:  # nothing was recorded yet
            return []

    def history(self, serial: str) -> list[dict[str, Any]]:
        """Return the entries of a device, oldest first; a BenchError where they cannot be read."""
        return [_entry(each) for each in DeviceStore(self._devices).device(serial).entries]

    def _row(self, directory: RunDirectory) -> dict[str, Any]:
        try:
            size = directory.journal.stat().st_size
        except OSError:
            return {"run": directory.run, "status": "unreadable"}
        known = self._known.get(directory.run)
        if known is None or known[0] != size:
            known = size, _row_of(directory)
            if known[1]["status"] not in {"running", "incomplete"}:
                self._known[directory.run] = known
        return known[1]

    def _device_rows(self) -> list[dict[str, Any]]:
        rows = []
        store = DeviceStore(self._devices)
        with suppress(BenchError):
            for serial in store.serials():
                with suppress(BenchError):
                    entries = store.entries(serial)
                    rows.append({"serial": serial, "entries": len(entries)})
        return rows


def _row_of(directory: RunDirectory) -> dict[str, Any]:
    """Return what the list shows of a run."""
    row: dict[str, Any] = {"run": directory.run, "status": "unreadable"}
    with suppress(BenchError):
        header = read_header(directory.journal)
        row |= {
            "procedure": header.get("procedure"),
            "bench": _of(header, "bench", "name"),
            "simulated": header.get("simulated"),
            "began_utc": header.get("utc"),
            "dut": _of(header, "metadata", "dut"),
        }
        outline = outline_of(directory.journal)
        if outline is not None:
            row |= {"status": outline.status.value, **_result(directory.path / "result.json")}
        else:
            row["status"] = "running" if being_written(directory.journal) else "incomplete"
    return row


def _of(values: Mapping[str, Any], *keys: str) -> Any:
    """Return what stands below `keys`, None where nothing does."""
    found: Any = values
    for key in keys:
        found = found.get(key) if isinstance(found, dict) else None
    return found


def _result(path: Path) -> dict[str, Any]:
    """Return verdict and the first values of what a run came to."""
    try:
        with path.open("rb") as file:
            answer = msgspec.json.decode(file.read(_LONGEST_RESULT), type=dict[str, Any])
    except (OSError, msgspec.DecodeError):
        return {}
    return {"verdict": _of(answer, "acceptance", "verdict"), "values": _values(answer)[:_KEY_VALUES]}


def _values(answer: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the values that a run states with their expanded uncertainty, in one list or one by one."""
    stated = _of(answer, "results", "uncertainty", "values")
    if isinstance(stated, list):
        listed = [(each.get("name"), each, each.get("u95")) for each in stated if isinstance(each, dict)]
    else:
        results = _of(answer, "results")
        found = results.items() if isinstance(results, dict) else ()
        listed = [(name, each, each.get("expanded_u")) for name, each in found if _is_stated(each)]
    return [
        {"name": name, "value": each.get("value"), "u95": u95, "unit": each.get("unit")} for name, each, u95 in listed
    ]


def _is_stated(value: Any) -> bool:
    return isinstance(value, dict) and isinstance(value.get("value"), float) and "unit" in value


def _entry(entry: Entry) -> dict[str, Any]:
    """Return what the history of a device shows of an entry."""
    record = entry.record
    if isinstance(record, Certificate):
        kind, done, result = "certificate", record.issued, f"K_Vc {record.k_vc.coefficients[1]:.6g} (deg/s)/V"
    else:
        kind, done, factor = "self-calibration", record.done, record.scale_factor_v_per_deg_s
        drift = "" if record.drift_ppm is None else f", drift {record.drift_ppm.value:+.0f} ppm"
        result = f"{1e3 * factor.value:.5f} mV/(deg/s), u {1e3 * factor.u:.2g}{drift} {record.verdict or ''}"
    run = record.conditions.run
    return {"entry": entry.name, "kind": kind, "finished": done.isoformat(), "run": run, "result": result}
