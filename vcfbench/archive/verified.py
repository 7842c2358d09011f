"""Integrity of a record: its seals, form, numbers, signatures, and the files next to the journal."""

import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from contextlib import suppress
from hashlib import sha256
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any, Final, Literal, get_args

import msgspec
from msgspec import Struct, field

from vcfbench.archive.projection import NOT_OF_DEVICES, projected
from vcfbench.archive.recorded import directory_of
from vcfbench.archive.results import evaluation_of
from vcfbench.errors import BenchError, ConfigError
from vcfbench.files import read_file, shown
from vcfbench.instructions.titles import BUILT_IN
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.records.amendments import amendments_of
from vcfbench.records.directory import RunDirectory
from vcfbench.records.export import points_csv
from vcfbench.records.journal import JournalRecord
from vcfbench.records.plain import plain
from vcfbench.records.schema import LineKind, Point, Status
from vcfbench.records.signing import is_signed
from vcfbench.steps.decode import Recorded, result_of, step_of
from vcfbench.steps.step import Step, StepResult
from vcfbench.typed import typed
from vcfbench.values.printing import second_digit
from vcfbench.values.value import Value
from vcfbench.version import other_versions

_MOST: Final = 1 << 30
_PRINTED: Final = 5e-3  # Of uncertainties two digits are printed: so they are the same


class Verification(Struct, frozen=True, kw_only=True):
    """Verification of a record: ``PASS``, or ``FAIL`` with the first deviation.

    `line` is the line of the journal that is wrong, None where it is something else; `notes` say what could not be
    known. `seal` is that of the last line, `signed_by` the public keys of the signatures that hold.
    """

    run: str
    verdict: Literal["PASS", "FAIL"]
    wrong: str | None = None
    line: int | None = None
    status: str | None = None
    lines: int = 0
    points: int = 0
    revision: int = 1
    seal: str | None = None
    signed_by: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def verify_run(run: str | Path, runs: str | Path = "runs", *, keys: Sequence[str] = ()) -> Verification:
    """Verify that the record of a run is unchanged since it was written.

    Checked are the chain of seals, form, order and counts of its lines, the files beside it, its results, which are
    computed again from its points, the record that it was resumed from where that is beside it, and signatures. No code
    that the record names is run.

    Args:
        run: directory of the run, its name under `runs` (or the beginning or end of it, or ``"last"``).
        runs: directory of the records.
        keys: public keys, in hexadecimal, of which one must have signed it; none: any may.

    Raises:
        ConfigError: there is no such record.
    """
    directory = directory_of(run, runs)
    try:
        record = directory.read()
    except ConfigError as error:
        changed = re.search(r": line (\d+)", str(error))
        return Verification(run=directory.run, verdict="FAIL", wrong=str(error), line=int(changed[1]) if changed else 1)
    check = _Check(directory, record, frozenset(keys))
    try:
        wrong = next(check.findings(), None)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, BenchError) as error:
        wrong = f"no record of this program: {error!r}"
    named = re.match(r"line (\d+)", wrong or "")
    return Verification(
        run=directory.run,
        verdict="PASS" if wrong is None else "FAIL",
        wrong=wrong,
        line=int(named[1]) if named else None,
        status=record.status.value,
        lines=len(record.lines),
        points=sum("point" in each for each in record.steps),
        revision=sum(each.get("type") == "amendment" for each in record.lines) + 1,
        seal=record.seal,
        signed_by=tuple(dict.fromkeys(check.signed_by)),
        notes=tuple(check.notes),
    )


class _Header(Struct, frozen=True):
    """Entries that every header has."""

    run: str
    procedure: str
    utc: str
    versions: dict[str, str]
    identities: dict[str, Any]
    settings: dict[str, Any]
    bench: dict[str, Any]
    metadata: dict[str, Any]
    equipment: list[dict[str, Any]]
    signed_by: str | None = None


class _Check(Struct):
    """The checks of one record, in their order; each yields deviations in words."""

    directory: RunDirectory
    record: JournalRecord
    keys: frozenset[str]
    notes: list[str] = field(default_factory=list)
    signed_by: list[str] = field(default_factory=list)

    def findings(self) -> Iterator[str]:
        """Yield the deviations, the most telling first."""
        record = self.record
        if record.damage is not None:
            yield record.damage
        if not record.header:
            yield "line 1: there is no whole header"
        yield from self._form()
        for number, each in enumerate(amendments_of(record.lines), 2):
            if each.revision != number:
                yield f"amendment {number - 1} says revision {each.revision}, it makes revision {number}"
        yield from self._signatures()
        yield from self._files()
        yield from self._results()
        yield from self._earlier()
        yield from self._of_several()
        notes = self.notes
        if record.torn:
            notes.append(f"it ends within line {len(record.lines) + 1}, which is ignored")
        if record.status is Status.RUNNING:
            notes.append("its run goes on")
        elif record.footer is None and not self.signed_by:
            notes.append("it has no footer and no signature: whether lines were cut off its end cannot be known")
        if not self.signed_by:
            notes.append("not signed: anyone with write access could have replaced it, or removed amendments")

    def _form(self) -> Iterator[str]:
        try:
            header = typed(self.record.header, _Header)
        except msgspec.ValidationError as error:
            yield f"line 1: no header of this program: {error}"
            return
        if header.run != self.directory.run:
            self.notes.append(f"the directory is called {self.directory.run}, the run was {header.run}")
        own, packages = set[str](), self._packages()
        for place, line in enumerate(self.record.lines, 1):
            kind = line.get("type")
            if kind not in get_args(LineKind):
                yield f"line {place}: lines of type {kind!r} are not known"
            if not isinstance(line.get("utc"), str):
                yield f"line {place}: it has no time of day"
            if kind in {"step", "restored"}:
                yield from (f"line {place}: {wrong}" for wrong in _step(line, packages, own))
        if own:
            self.notes.append(f"steps that are not known here were not looked into: {', '.join(sorted(own))}")

    def _packages(self) -> AbstractSet[str]:
        """Load what brings the kinds of the record's steps, and return the packages whose kinds are looked into.

        Those that come along may be in any record; others are what the record's own procedure has, whatever else is
        loaded.
        """
        for name in BUILT_IN:
            _ = PROCEDURES[name]
        with suppress(ConfigError):  # the results say that it cannot be loaded
            procedure = PROCEDURES.get(str(self.record.header.get("procedure")))
            return {"vcfbench", *([] if procedure is None else [procedure.plan.__module__.partition(".")[0]])}
        return {"vcfbench"}

    def _signatures(self) -> Iterator[str]:
        """Hold each signature against the seal before it; a record that was to be signed must end with one."""
        record, signed = self.record, False
        promised = record.header.get("signed_by")
        for place, line in enumerate(record.lines):
            if line.get("type") == "signature":
                if not is_signed(line, record.seals[place - 1]):
                    yield f"line {place + 1} is no signature of the line before"
                if self.keys and line["key"] not in self.keys:
                    yield f"line {place + 1} is signed by another key: {line['key']}"
                self.signed_by.append(line["key"])
                signed = True
            elif line.get("type") != "amendment":
                signed = False
            elif promised is not None and not signed:  # who amends signs what is amended, not what was measured
                yield f"line {place + 1} amends what was to be signed before, and is not"
        yield from self._end(promised, signed=signed)

    def _end(self, promised: str | None, *, signed: bool) -> Iterator[str]:
        if not signed:
            if self.keys:
                yield "it ends without a signature"
            if promised is not None and self.record.status is not Status.RUNNING:
                yield "it was to be signed, and ends without a signature: lines may be missing from its end"
            return
        if promised not in self.signed_by:
            yield f"it is not signed by the key that its header names, {promised}"
        if self.record.lines[-1].get("type") != "signature":
            if self.keys:
                yield "what was amended after the last signature is not signed"
            self.notes.append("what was amended after the last signature is not signed")
        if not self.keys:
            self.notes.append("the signing key was not checked (--key)")

    def _files(self) -> Iterator[str]:
        """Hold the files beside the journal against their sums in the footer."""
        if self.record.footer is None and self.record.status is not Status.RUNNING:
            for name in ("points.csv", "result.json"):
                if (self.directory.path / name).exists():
                    yield f"{name} is made when the last line is, which is missing"
        for name, stated in ((self.record.footer or {}).get("files") or {}).items():
            try:
                data = read_file(self.directory.path / Path(name).name, "a file of the record", _MOST)
            except ConfigError as error:
                yield error.what
                continue
            if sha256(data.replace(b"\r\n", b"\n")).hexdigest() != stated:
                yield f"{shown(name)} is not what was written: its SHA-256 differs"

    def _results(self) -> Iterator[str]:
        """Compute points.csv and the results again."""
        record, path = self.record, self.directory.path
        if record.footer is None or record.footer.get("physical_minimum_s") is None:
            return
        written = read_file(path / "points.csv", "the points of a run", _MOST).replace(b"\r\n", b"\n")
        if written.decode() != points_csv(record.points):
            yield "points.csv has other points than the journal"
        stored = msgspec.json.decode(read_file(path / "result.json", "the result of a run", _MOST))
        if stored.get("points") != [each.as_json() for each in record.points]:
            yield "result.json has other points than the journal"
        if stored.get("status") != record.status.value or stored.get("procedure") != record.header.get("procedure"):
            yield "result.json is of another run"
        if record.status is not Status.COMPLETE:
            return
        evaluation, why_not = evaluation_of(self.directory, record)
        if why_not is not None:
            self.notes.append(f"the results were not computed again: {why_not}")
            return
        verdict = None if evaluation.verdict is None else evaluation.verdict.as_json()
        again = json.loads(msgspec.json.encode({"results": plain(evaluation.results), "acceptance": verdict}))
        of_record = {key: stored.get(key) for key in again}
        self.notes += _by_earlier_rules(of_record, again)
        differing = next(_differences(of_record, again), None)
        others = other_versions(self.record.header)
        if differing is not None and others:
            self.notes.append(f"computed again with other versions ({others}): {differing}")
        elif differing is not None:
            values = typed(stored.get("values") or [], tuple[Value, ...])
            as_printed = chain(
                _differences(_numbers_of(of_record), _numbers_of(again), close=_PRINTED),
                _not_as_printed(values, {each.name: each for each in evaluation.values}),
            )
            yield from (f"result.json: {each}" for each in as_printed)
            self.notes.append(f"computed again, equal only as far as printed: {differing}")
        elif others:
            self.notes.append(f"computed again with other versions, to the same: {others}")

    def _of_several(self) -> Iterator[str]:
        """Hold the lines of one of several devices against the record of their run, where that is beside this one."""
        of = self.record.header.get("several")
        if not isinstance(of, dict):
            return
        name = str(of.get("run"))
        whole = RunDirectory(self.directory.path.parent / Path(name).name)
        if not whole.journal.is_file():
            self.notes.append(f"{name}, the run of all its devices, is missing: its lines cannot be compared")
            return
        run = whole.read()
        if run.damage is not None:
            yield f"{name}, the run of all its devices: {run.damage}"
        if of.get("seal") not in run.seals:
            yield f"{name}, the run of all its devices, is another: it has not the seal {of.get('seal')}"
        settings = {each["name"]: each["settings"] for each in run.header["devices"]}
        if settings.get(of.get("device")) != self.record.header["settings"]:
            yield f"line 1: its settings are not those of {of.get('device')} in {name}"
        own = [each for each in self.record.lines if each["type"] not in NOT_OF_DEVICES]
        again = list(projected(run.lines, str(of.get("device"))))
        for place, (mine, its) in enumerate(zip_longest(own, again), 2):
            if mine != its:
                yield f"line {place}: it is not that of {of.get('device')} in {name}"

    def _earlier(self) -> Iterator[str]:
        """Hold the steps taken over against the record that they come from, where that is beside this one."""
        resumed_from = self.record.header.get("resumed_from")
        if not isinstance(resumed_from, dict) or "several" in self.record.header:  # it is their run that was resumed
            return
        name = str(resumed_from.get("run"))
        earlier = RunDirectory(self.directory.path.parent / Path(name).name)
        if not earlier.journal.is_file():
            self.notes.append(f"{name}, which it was resumed from, is missing: the copied steps cannot be compared")
            return
        before = earlier.read()
        if before.damage is not None:
            yield f"{name}, which it was resumed from: {before.damage}"
        if resumed_from.get("seal") is not None and resumed_from["seal"] not in before.seals:
            yield f"{name}, which it was resumed from, has a different seal: it was changed, or lines were cut off"
        had = {line["n"]: _apart(line) for line in before.steps}
        for place, line in enumerate(self.record.lines, 1):
            if line.get("type") == "step" and "taken_over" in line and had.get(line["n"]) != _apart(line):
                yield f"line {place}: step {line['n']} is not that of {name}"


def _step(line: Mapping[str, Any], packages: AbstractSet[str], own: set[str]) -> Iterator[str]:
    """Yield the deviations of a step: its form, its key, its point; kinds that are of no `packages` go to `own`."""
    kinds = ((Step.kinds, line["step_kind"]), (StepResult.kinds, line["result_kind"]))
    others = {
        name for known, name in kinds if name not in known or known[name].__module__.split(".")[0] not in packages
    }
    own |= others
    step, result = step_of(line), result_of(line)
    if line["step_kind"] in others:
        return
    if isinstance(step, Recorded):
        yield f"a {step.kind} of this form is not known"
    elif step.key != line["key"]:
        yield f"it says {step.key}, its key is {line['key']}"
    elif line["result_kind"] in others:
        return
    elif isinstance(result, Recorded):
        yield f"a {result.kind} of this form is not known"
    elif line["type"] == "step" and result.recorded_point != (
        Point.from_json(line["point"]) if "point" in line else None
    ):
        yield "its point is not that of its result"
    elif {name: each.as_json() for name, each in result.recorded_points.items()} != line.get("points", {}):
        yield "its points are not those of its results"


def _apart(line: Mapping[str, Any]) -> dict[str, Any]:
    """Return a step without the changes by being taken over."""
    return {key: value for key, value in line.items() if key not in {"taken_over", "utc", "seal"}}


def _by_earlier_rules(of_record: dict[str, Any], again: dict[str, Any]) -> Iterator[str]:
    """Take out a stored verdict that does not say by which rules it was found; say where it is another by those of now.

    Verdicts have said so since they have more rules than one.
    """
    acceptance = of_record["acceptance"]
    limits = acceptance.get("limits", ()) if isinstance(acceptance, dict) else ()
    if any("rule" not in each and each.get("verdict") != "not measured" for each in limits):
        was, now = acceptance.get("verdict"), (again["acceptance"] or {}).get("verdict")
        del of_record["acceptance"]
        if was != now:
            yield f"the verdict, {was}, is by the rules of that version; by the present rules it is {now}"


def _not_as_printed(stored: Sequence[Value], again: Mapping[str, Value]) -> Iterator[str]:
    """Yield the values that would be printed otherwise now, by more than one of their last digit."""
    for was in stored:
        now = again.get(was.name)
        u = was.u or was.u95
        last = 10.0 ** second_digit(u) if u else 1e-6 * abs(was.value or 0.0)
        numbers = (was.value, was.u95, *was.ends), (now.value, now.u95, *now.ends) if now else (None,) * 4
        apart = any(a != b and (a is None or b is None or abs(a - b) > last) for a, b in zip(*numbers, strict=True))
        if now is None or apart or (was.form, was.missing) != (now.form, now.missing):
            yield f"{was.name} is {was.with_u95}, the points give {'none' if now is None else now.with_u95}"


def _numbers_of(value: Any) -> Any:
    """Return results without their texts, which say in words what they are, and without what has digits by its u."""
    if isinstance(value, dict):
        by_u = {"value", "low", "high"} if "u" in value else set()
        return {key: _numbers_of(each) for key, each in value.items() if key not in by_u}
    if isinstance(value, list):
        return [_numbers_of(each) for each in value]
    return "" if isinstance(value, str) else value


def _differences(stored: Any, again: Any, name: str = "", *, close: float = 1e-6) -> Iterator[str]:
    """Yield in words where stored results are not those that were computed again, up to rounding."""
    if isinstance(stored, dict) and isinstance(again, dict):
        for key in stored:  # one that is new since is none of the record
            yield from _differences(stored.get(key), again.get(key), f"{name}.{key}".removeprefix("."), close=close)
    elif isinstance(stored, list) and isinstance(again, list) and len(stored) == len(again):
        for place, (one, other) in enumerate(zip(stored, again, strict=True)):
            yield from _differences(one, other, f"{name}[{place}]", close=close)
    elif isinstance(stored, int | float) and isinstance(again, int | float):
        if not math.isclose(stored, again, rel_tol=close, abs_tol=1e-12):
            yield f"{name} is {stored!r}, the points give {again!r}"
    elif stored != again:
        yield f"{name} is {str(stored)[:60]!r}, the points give {str(again)[:60]!r}"
