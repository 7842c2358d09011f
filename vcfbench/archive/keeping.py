"""Device entry of a complete record, added to the device store where the run itself could not."""

from datetime import datetime
from pathlib import Path

from vcfbench.archive.recorded import directory_of
from vcfbench.archive.results import evaluation_of
from vcfbench.errors import ConfigError
from vcfbench.procedures.catalogue import procedure
from vcfbench.procedures.layers import recorded_settings
from vcfbench.procedures.procedure import Provenance
from vcfbench.records.devices import DeviceStore, Entry, withdrawn
from vcfbench.records.schema import Status


def keep_of_device(run: str | Path, runs: str | Path = "runs", devices: Path | None = None) -> Entry:
    """Add the device entry of a complete run, as the run does at its end; `devices` is another store than its own.

    Raises:
        ConfigError: the run is not complete or keeps nothing of a device, its entry is there already, or the store
            does not take it.
    """
    directory = directory_of(run, runs)
    record = directory.read()
    evaluation, why_none = evaluation_of(directory, record)
    if record.status is not Status.COMPLETE or why_none is not None:
        raise ConfigError(f"{directory.run} has no results to be kept: {why_none}")
    if record.footer is None or record.footer.get("error") is not None:
        raise ConfigError(f"{directory.run} ended with an error: nothing of it is kept")
    chosen = procedure(str(record.header.get("procedure")))
    settings = recorded_settings(chosen, record.header.get("settings"))
    finished = datetime.fromisoformat(record.footer["utc"])
    made = Provenance.of(record.header, directory.run, finished, evaluation.verdict)
    kept = None if chosen.entry is None else chosen.entry(settings, evaluation.results, made)
    if kept is None:
        raise ConfigError(f"{directory.run} keeps nothing of a device", hint="run it with --dut SERIAL")
    store = DeviceStore(kept.store if devices is None else devices)
    entries = store.entries(kept.record.serial)
    for each in (one for one in entries if one.name not in withdrawn(entries)):
        if each.run == directory.run:
            raise ConfigError(f"{each.path} is what {directory.run} keeps of its device already")
    return store.add(kept.record)
