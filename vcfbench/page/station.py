"""The records and devices of a station, as its page lists them."""

from contextlib import suppress
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from vcfbench.archive.batch_sheet import rehearsals, sheet_rows, write_sheet
from vcfbench.archive.summary import summary_of
from vcfbench.errors import BenchError, ConfigError
from vcfbench.records.devices import (
    Certificate,
    Characterisation,
    DeviceStore,
    Entry,
    SelfCalibration,
    StaticNoise,
    Withdrawal,
    withdrawn,
)
from vcfbench.records.directory import RunDirectory
from vcfbench.records.journal import being_written, read_header

_MOST_RUNS: Final = 500
_KEY_VALUES: Final = 3


class StationDirectories:
    """Contents of the directories of a station; a record that is complete is read once."""

    def __init__(self, runs: Path, devices: Path) -> None:
        self._runs, self._devices = runs, devices
        self._known: dict[str, tuple[int, dict[str, Any]]] = {}

    def listed(self) -> dict[str, Any]:
        """Return the latest runs, newest first, and the devices."""
        names = self._names()
        found = (self._row(RunDirectory(self._runs / name)) for name in names[:_MOST_RUNS])
        rows = [row for row in found if row is not None]
        devices, store = [], DeviceStore(self._devices)
        with suppress(BenchError):
            for serial in store.serials():
                with suppress(BenchError):
                    known = store.device(serial)
                    failed = None if known.failed_since is None else known.failed_since.name
                    devices.append({"serial": serial, "entries": len(known.entries), "failed_since": failed})
        return {
            "runs": sorted(rows, key=lambda row: str(row.get("began_utc") or row["run"]), reverse=True),
            "older": max(0, len(names) - _MOST_RUNS),
            "devices": devices,
        }

    def directory(self, name: str) -> RunDirectory:
        """Return the run of exactly that name; ConfigError without one."""
        directory = RunDirectory(self._runs / name)
        if name not in self._names() or not directory.journal.is_file():
            raise ConfigError("there is no such run")
        return directory

    def _names(self) -> list[str]:
        """Return the names of the runs, the latest first: they begin with the time."""
        try:
            return sorted((each.name for each in self._runs.iterdir() if each.is_dir()), reverse=True)
        except OSError:  # nothing was recorded yet
            return []

    def sheet(self, batch: str, kind: str) -> bytes:
        """Return the sheet of a batch as html, pdf, md or xlsx; BenchError for another suffix."""
        left_out = rehearsals(batch, self._runs)
        rows = sheet_rows(batch, self._runs, left_out, self._devices)
        if not rows:
            raise ConfigError(f"there is no batch {batch!r}")
        with TemporaryDirectory() as folder:
            (path, *_) = write_sheet(batch, rows, Path(folder) / f"sheet.{kind}", left_out)
            return path.read_bytes()

    def history(self, serial: str) -> list[dict[str, Any]]:
        """Return the entries of a device, oldest first; a BenchError where they cannot be read."""
        known = DeviceStore(self._devices).device(serial)
        gone, counting = withdrawn(known.entries), {each.name for each in known.standing}
        rows = []
        for each in known.entries:
            row = _entry(each)
            if each.name in gone:
                row["result"] += f"; withdrawn by {gone[each.name].by}: {gone[each.name].reason}"
            elif each.run is not None and each.name not in counting:
                row["result"] += "; left out, from a simulated bench"
            rows.append(row)
        return rows

    def _row(self, directory: RunDirectory) -> dict[str, Any] | None:
        """Return the row of a run; None where there is no journal."""
        try:
            size = directory.journal.stat().st_size
        except OSError:
            return None
        known = self._known.get(directory.run)
        if known is None or known[0] != size:
            known = size, _row_of(directory)
            if known[1]["status"] != "running":
                self._known[directory.run] = known
        return known[1]


def _row_of(directory: RunDirectory) -> dict[str, Any]:
    """Return the row of a run in the list; of one that goes on no more than its beginning is read."""
    try:
        header = read_header(directory.journal)
    except BenchError:
        header = {}
    begun = {"run": directory.run, "began_utc": header.get("utc"), "simulated": header.get("simulated")}
    if being_written(directory.journal):
        bench, metadata = header.get("bench") or {}, header.get("metadata") or {}
        stated = {"procedure": header.get("procedure"), "bench": bench.get("name"), "dut": metadata.get("dut")}
        return {**begun, **stated, "status": "running"}
    summary = summary_of(directory)
    return {
        **begun,
        **{name: getattr(summary, name) for name in ("procedure", "bench", "dut", "verdict")},
        "began_utc": summary.started.isoformat(),
        "batch": summary.tags.get("batch"),
        "status": summary.status.value,
        "problem": summary.problem or summary.damage,
        "values": [
            {"name": each.named.words, "words": str(each)} for each in islice(summary.results.values(), _KEY_VALUES)
        ],
    }


def _entry(entry: Entry) -> dict[str, Any]:
    """Return the row of an entry in the history of a device."""
    record, verdict = entry.record, None
    match record:
        case Certificate():
            result = f"K_Vc {record.k_vc.coefficients[1]:.6g} (deg/s)/V"
        case StaticNoise(bias_instability_deg_h=found):
            result = f"B {found.value:.3g} deg/h, u {found.u:.2g}"
        case Withdrawal():
            result = f"{record.withdraws} is not used any more: {record.reason} ({record.by})"
        case Characterisation():
            result = f"by {record.procedure}"
        case SelfCalibration(scale_factor_v_per_deg_s=factor):
            drift = "" if record.drift_ppm is None else f", drift {record.drift_ppm.value:+.0f} ppm"
            verdict, result = record.verdict, f"{1e3 * factor.value:.5f} mV/(deg/s), u {1e3 * factor.u:.2g}{drift}"
    row = {"entry": entry.name, "kind": record.__struct_config__.tag, "finished": entry.done.isoformat()}
    return {**row, "run": entry.run, "result": result, "verdict": verdict}
