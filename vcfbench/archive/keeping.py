"""Device entries of records: added where the run itself could not, and the runs that a withdrawal leaves."""

from collections.abc import Iterable
from datetime import datetime
from pathlib import Path

from vcfbench.archive.recorded import directory_of
from vcfbench.archive.results import evaluation_of
from vcfbench.archive.summary import RunSummary
from vcfbench.devices.device import KnownDevice
from vcfbench.errors import ConfigError
from vcfbench.files import shown
from vcfbench.instructions.procedure import Provenance
from vcfbench.procedures.catalogue import procedure
from vcfbench.procedures.layers import recorded_settings
from vcfbench.records.amendments import amended, amendments_of
from vcfbench.records.devices import DeviceStore, Entry, withdrawn
from vcfbench.records.metadata import metadata_from
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
        raise ConfigError(f"{directory.run} has no results for the device history: {why_none}")
    if record.footer is None or record.footer.get("error") is not None:
        raise ConfigError(f"{directory.run} ended with an error, so its results are not added to the device history")
    chosen = procedure(str(record.header.get("procedure")))
    settings = recorded_settings(chosen, record.header.get("settings"))
    finished = datetime.fromisoformat(record.footer["utc"])
    made = Provenance.of(record.header, directory.run, finished, evaluation.verdict)
    kept = None if chosen.entry is None else chosen.entry(settings, evaluation.results, made)
    if kept is None:
        hint = f"{chosen.name} makes none" if chosen.entry is None else "run it with --dut SERIAL"
        raise ConfigError(f"{directory.run} has no entry for the device history", hint=hint)
    now = amended(metadata_from(record.header), amendments_of(record.lines)).dut
    if now is not None and now != kept.record.serial:
        raise ConfigError(
            f"{directory.run} was amended to device {now}, but used the history of {kept.record.serial}: "
            "its results are not added to the device history"
        )
    store = DeviceStore(kept.store if devices is None else devices)
    entries = store.entries(kept.record.serial)
    known: KnownDevice | None = getattr(settings.station, "known", None)
    if known is not None and known.certificate is not None:
        used = next((each for each in entries if each.name == known.certificate), None)
        if used is None or used.done.isoformat() != known.issued:  # another store's entry of the same number
            raise ConfigError(
                f"{shown(store.root)}: {known.certificate} is not the certificate of {known.issued} there, "
                f"by which {directory.run} went"
            )
    for each in (one for one in entries if one.name not in withdrawn(entries)):
        if each.run == directory.run:
            raise ConfigError(f"{directory.run} has already been added to the device history: {each.path}")
    return store.add(kept.record)


def not_withdrawn(found: Iterable[RunSummary], devices: str | Path) -> list[RunSummary]:
    """Return the runs without those whose every entry in the history of their device was withdrawn.

    ConfigError: the history of one of the devices cannot be read.
    """
    found, root, gone = list(found), Path(devices), set[tuple[str, str | None]]()
    for serial in {each.dut for each in found if each.dut and (root / each.dut).is_dir()}:
        entries = DeviceStore(root).entries(serial)
        names = withdrawn(entries)
        stay = {each.run for each in entries if each.name not in names}
        gone |= {(serial, each.run) for each in entries if each.run is not None and each.run not in stay}
    return [each for each in found if (each.dut, each.recorded_as) not in gone]
