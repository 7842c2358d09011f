"""Several gyroscopes in one run: makes the record of each from the record of the run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vcfbench.archive.projection import ending, projected
from vcfbench.archive.run import Run
from vcfbench.errors import BenchError
from vcfbench.records.directory import create_run
from vcfbench.records.schema import Point, Status
from vcfbench.runs.request import OneDevice, Prepared
from vcfbench.runs.under_way import UnderWay
from vcfbench.steps.each import EndedStep
from vcfbench.steps.executor import Execution


class _PreparedDevice(Prepared):
    """The run of one of several devices, as it would have been prepared alone."""

    def __init__(self, whole: Prepared, device: OneDevice, header: Mapping[str, Any]) -> None:
        super().__init__(whole.request)
        self.procedure, self.name = whole.procedure, whole.name
        self.description, self.settings, self.metadata = device.description, device.settings, device.metadata
        self.seed, self.simulated, self.began_s = whole.seed, whole.simulated, whole.began_s
        self._entries = header

    def header_entries(self) -> dict[str, Any]:
        """Return the additional entries of the header: the run that it is of."""
        return {**super().header_entries(), **self._entries}


def device_runs(whole: UnderWay) -> tuple[Run, ...]:
    """Make the record of each device of a run that has ended; return the run of each."""
    prepared, journal = whole.prepared, whole.journal
    if journal is None or whole.execution is None:
        return tuple(
            Run(prepared.name, Status.ABORTED, error=_own(whole.error, each.name), metadata=each.metadata)
            for each in prepared.devices
        )
    lines = journal.lines()
    header = last = next(lines)
    ends: dict[str, EndedStep] = {}
    for last in lines:
        ends |= ending(last)
    return tuple(_device_run(whole, each, header, last.get("seal"), ends.get(each.name)) for each in prepared.devices)


def _device_run(
    whole: UnderWay, device: OneDevice, header: Mapping[str, Any], seal: object, ended: EndedStep | None
) -> Run:
    prepared, journal, execution = whole.prepared, whole.journal, whole.execution
    assert journal is not None  # noqa: S101  # there is a header
    assert execution is not None  # noqa: S101  # as above
    directory, entries = prepared.directory, {"utc": header["utc"]}
    if directory is not None:
        entries["several"] = {"run": directory.run, "device": device.name, "seal": seal}
    if isinstance(before := header.get("resumed_from"), dict):
        taken = [line for line in projected(journal.lines(), device.name) if "taken_over" in line]
        entries["resumed_from"] = {**before, "points": sum("point" in line for line in taken)}
    own = UnderWay(_PreparedDevice(prepared, device, entries), key=whole.key, safe_reports=whole.safe_reports)
    if directory is not None:
        own.prepared.directory = create_run(directory.path.parent, prepared.name)
    identities = {role: each for role, each in whole.identities.items() if role != "multimeter"}
    if (found := whole.outputs.get(device.name)) is not None:
        identities["multimeter"] = found
    own.journal = own.open_journal(identities, header["began_s"], header["planned_s"], planned=False)
    points = []
    for line in projected(journal.lines(), device.name):
        own.journal.write(line["type"], line)
        points += [Point.from_json(line["point"])] if "point" in line else []
    error = ended.error if ended is not None else whole.missing.get(device.name) or _own(whole.error, device.name)
    own.execution = Execution(
        Status.COMPLETE if error is None else Status.ABORTED,
        tuple(points),
        error,
        execution.bench_seconds,
        execution.physical_minimum_s,
        not_checked=execution.not_checked,
        pauses=execution.pauses,
    )
    if error is not None:
        own.take_error(error)
    own.close(None)
    return own.as_run()


def _own(error: BenchError | None, device: str) -> BenchError | None:
    """Return what an error of the run was for one device."""
    return error and error.of_devices.get(device, error)
