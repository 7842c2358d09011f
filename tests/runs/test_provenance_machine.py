"""Real and simulated records and entries of two devices, in whatever order they come, end and are amended.

Over midnight too, and in any time zone. Records are copies of a few that were made; a real one says so in its header,
and its lines have the times of a run that took as long on the calendar as by its bench.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from datetime import UTC, date, datetime, timedelta
from functools import cache
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from msgspec import Struct, structs

import vcfbench
from vcfbench.archive.amending import amend_run
from vcfbench.archive.batch_sheet import batch_sheet, device_rows
from vcfbench.archive.days import days_of
from vcfbench.archive.keeping import keep_of_device
from vcfbench.errors import ConfigError
from vcfbench.page.panel import Panel
from vcfbench.procedures.layers import asked_in_python, settings_of
from vcfbench.procedures.self_calibration.plan import SELF_CALIBRATION
from vcfbench.records.device_values import Conditions, Measured
from vcfbench.records.devices import Certificate, DeviceStore, KvcCurve, SelfCalibration, StaticNoise, withdrawn
from vcfbench.records.journal import SimulatedJournal, read_journal
from vcfbench.reports.text import text_of
from vcfbench.runs.batch import Batch, read_batch
from vcfbench.station.file import embedded_text
from vcfbench.steps import Effect, Step

if TYPE_CHECKING:
    from vcfbench.records.devices import DeviceRecord

DEVICES = ("G-1", "G-2")
SETTINGS: dict[str, Any] = {"rates_deg_s": [-10.0, 0.0, 10.0], "samples": 2}
PLAN = """name = "b7"
bench = "bench.toml"
devices = ["G-1", "G-2"]
[[runs]]
procedure = "turntable"
settings = { rates_deg_s = [-10, 0, 10], samples = 2 }
[[runs]]
procedure = "polarity"
"""
DAY = datetime(2026, 5, 4, 23, 30, tzinfo=UTC)
CURVE = KvcCurve(coefficients=(0.0, 150.0), covariance=((0.0, 0.0), (0.0, 1e-6)), v_vc_min_v=-2.0, v_vc_max_v=2.0)
SIMULATED = st.booleans()
DEVICE = st.sampled_from(DEVICES)
ZONES = ("UTC", "Pacific/Auckland", "America/Los_Angeles")
NIGHT = timedelta(hours=11)
"""A pause, and the break before a run is resumed."""


class Made(Struct, frozen=True):
    """A record as the model knows it; `ran_as` is the device that it was of before all amendments."""

    path: Path
    device: str
    kind: str
    simulated: bool
    ran_as: str
    days: tuple[date, date]
    tagged: bool = True

    @property
    def whole(self) -> bool:
        """Whether it came to its end."""
        return not self.kind.startswith("stopped")

    @property
    def procedure(self) -> str:
        """The procedure of the record."""
        kind = self.kind.removeprefix("stopped ")
        return kind if kind in {"polarity", "power"} else "turntable"

    @property
    def asked(self) -> bool:
        """Whether it is what the plan asks for."""
        return self.tagged and self.kind not in {"other settings", "power", "stopped power"}


class Pausing:
    """Has a run pause and go on at its 36th step."""

    def __init__(self) -> None:
        self.control = vcfbench.RunControl()

    def handle(self, event: vcfbench.Event) -> None:
        if isinstance(event, vcfbench.StepStarted) and event.number == 36:
            self.control.pause("a person")
        if isinstance(event, vcfbench.Paused):
            self.control.go_on("a person")


@cache
def templates() -> tuple[Path, dict[str, Path], frozenset[str]]:
    """Return the folder of bench and plan, a record of each kind, and the kinds that fail by a limit of the bias."""
    folder = Path(tempfile.mkdtemp())
    bias = [vcfbench.run("turntable", "paper", seed=s, settings=SETTINGS, runs=None).results.bias.value for s in (1, 2)]
    good, bad = (1, 2) if bias[0] < bias[1] else (2, 1)
    limits = f"\n[acceptance]\nbias_v = [-1, {sum(bias) / 2.0!r}]\n"
    (folder / "bench.toml").write_text(embedded_text("paper").replace("sim://paper", "COM1") + limits, "utf-8")
    (folder / "plan.toml").write_text(PLAN, "utf-8")
    asked: dict[str, tuple[str, int, dict[str, Any]]] = {
        "pass": ("turntable", good, SETTINGS),
        "fail": ("turntable", bad, SETTINGS),
        "other settings": ("turntable", good, {**SETTINGS, "samples": 3}),
        "paused": ("turntable", good, SETTINGS),
        "polarity": ("polarity", 1, {}),
        "power": ("power", 1, {"samples": 2, "dut": "G-1", "devices": str(folder / "devices")}),
    }
    found = {}
    for kind, (name, seed, own) in asked.items():
        pausing = Pausing()
        heard = {"observers": [pausing], "control": pausing.control} if kind == "paused" else {}
        made = vcfbench.run(name, folder / "bench.toml", seed=seed, settings=own, runs=folder / "runs", **heard)
        found[kind] = made.directory
    cut = folder / "cut" / found["pass"].name
    cut.mkdir(parents=True)
    lines = (found["pass"] / "journal.jsonl").read_bytes().splitlines(keepends=True)
    second = [place for place, line in enumerate(lines, 1) if b'"point":' in line][1]
    (cut / "journal.jsonl").write_bytes(b"".join(lines[:second]))
    found["resumed"] = vcfbench.resume(cut).directory
    judged = {kind: vcfbench.load_run(path).verdict for kind, path in found.items()}
    fails = frozenset(kind for kind, verdict in judged.items() if verdict is not None and verdict.word == "fail")
    assert fails & {"pass", "fail", "other settings"} == {"fail"}  # of the others it is by chance
    return folder, found, fails


class Provenance(RuleBasedStateMachine):
    """One batch on a real and on a simulated bench, and one store of devices."""

    def __init__(self) -> None:
        super().__init__()
        self.root = Path(tempfile.mkdtemp())
        self.runs, self.store = self.root / "runs", DeviceStore(self.root / "devices")
        folder, self.templates, self.fails = templates()
        plan = read_batch(folder / "plan.toml")
        real = structs.replace(plan, description=structs.replace(plan.description, simulation=None))
        self.plans: dict[bool, Batch] = {True: plan, False: real}
        self.made: list[Made] = []
        self.begun: dict[Path, datetime] = {}
        self.gone: set[tuple[str, str]] = set()
        self.now, self.number = DAY, 0
        self.looked: dict[str, Any] = {}
        self.zone = os.environ.get("TZ")

    def teardown(self) -> None:
        shutil.rmtree(self.root)
        self.travel(self.zone or "UTC")
        if self.zone is None:
            del os.environ["TZ"]

    @rule(minutes=st.sampled_from([29, 14 * 60, 3 * 24 * 60]))
    def wait(self, minutes: int) -> None:
        self.now += timedelta(minutes=minutes)

    @rule(zone=st.sampled_from(ZONES))
    def travel(self, zone: str) -> None:
        os.environ["TZ"] = zone
        time.tzset()

    @initialize()
    def begin(self) -> None:
        self.runs.mkdir()

    @rule(
        device=DEVICE,
        kind=st.sampled_from(["pass", "fail", "other settings", "paused", "polarity", "power"]),
        simulated=SIMULATED,
    )
    def run(self, device: str, kind: str, *, simulated: bool) -> None:
        self._record(device, kind, simulated=simulated)

    @rule(device=DEVICE, kind=st.sampled_from(["pass", "polarity"]), simulated=SIMULATED)
    def stop(self, device: str, kind: str, *, simulated: bool) -> None:
        self._record(device, kind, simulated=simulated, whole=False)

    @precondition(lambda self: any(each.kind == "stopped pass" for each in self.made))
    @rule(which=st.integers(0))
    def resume(self, which: int) -> None:
        """Another record goes on with it, and has its readings."""
        them = [each for each in self.made if each.kind == "stopped pass"]
        earlier = them[which % len(them)]
        self.now += NIGHT
        self._record(earlier.device, "resumed", simulated=earlier.simulated, earlier=earlier.path)

    def _record(
        self, device: str, kind: str, *, simulated: bool, whole: bool = True, earlier: Path | None = None
    ) -> None:
        """Copy a record for a device, on a real or a simulated bench; it begins now."""
        source, began, self.number = self.templates[kind], self.now, self.number + 1
        record = read_journal(source / "journal.jsonl")
        path = self.runs / f"{began:%Y%m%dT%H%M%SZ}-{record.header['procedure']}-{self.number:06x}"
        path.mkdir()
        bench = record.header["bench"] if simulated else {**record.header["bench"], "simulation": None}
        told = {"dut": device, "tags": {"batch": "b7"}}
        header = {"run": path.name, "utc": began.isoformat(), "simulated": simulated, "bench": bench, "metadata": told}
        if kind == "power":
            header["settings"] = {**record.header["settings"], "dut": device}
        if earlier is not None:
            header["resumed_from"] = {**record.header["resumed_from"], "run": earlier.name}
        journal = SimulatedJournal(path / "journal.jsonl")
        journal.header({**_own(record.header), **header})
        read: list[datetime] = []
        paused, utc = timedelta(), began
        for line in record.lines[1:] if whole else record.lines[1:4]:
            taken_over = earlier is not None and "taken_over" in line
            end_s, t_s = (0.0 if simulated else float(line.get(key, 0.0)) for key in ("end_s", "t_s"))
            if "t_s" in line:  # the last one has no time but that of the line before it
                utc = (self.begun[earlier] if taken_over else began + paused) + timedelta(seconds=end_s or t_s)
            step = Step.kinds.get(line.get("step_kind", ""))
            if line["type"] == "step" and step is not None and step.effect is Effect.MEASURES:
                read += [utc - timedelta(seconds=end_s - t_s), utc]
            journal.write(line["type"], {**_own(line), "utc": utc.isoformat()})
            paused += NIGHT if line["type"] == "went_on" else timedelta()
        self.now = utc + timedelta(minutes=1)
        if whole:
            for name in ("points.csv", "result.json"):
                shutil.copy(source / name, path / name)
        journal.close()
        self.begun[path] = began
        days = (min(read).date(), max(read).date()) if read else (began.date(),) * 2
        self.made.append(Made(path, device, kind if whole else f"stopped {kind}", simulated, device, days))

    @precondition(lambda self: any(each.kind == "power" for each in self.made))
    @rule(which=st.integers(0))
    def add(self, which: int) -> None:
        """What a run kept nowhere is kept of its device, once, and in its own world."""
        them = [each for each in self.made if each.kind == "power"]
        made = them[which % len(them)]
        standing = {each.run for of in (True, False) for each in DeviceStore(self.store.root, of).standing(made.ran_as)}
        if made.device != made.ran_as or made.path.name in standing:
            with pytest.raises(ConfigError, match=r"was amended to device|has already been added"):
                keep_of_device(made.path, self.runs, self.store.root)
            return
        entry = keep_of_device(made.path, self.runs, self.store.root)
        assert (entry.simulated, entry.run) == (made.simulated, made.path.name)
        assert entry.done.astimezone(UTC).date() >= made.days[1]

    @precondition(lambda self: self.made)
    @rule(which=st.integers(0), device=DEVICE)
    def amend(self, which: int, device: str) -> None:
        place = which % len(self.made)
        if (made := self.made[place]).device != device:
            amend_run(made.path, {"dut": device}, reason="misread", by="A. Person")
            self.made[place] = structs.replace(made, device=device)

    @precondition(lambda self: any(each.tagged for each in self.made))
    @rule(which=st.integers(0))
    def take_out(self, which: int) -> None:
        place = which % len(self.made)
        if (made := self.made[place]).tagged:
            amend_run(made.path, {"tags.batch": ""}, reason="another lot", by="A. Person")
            self.made[place] = structs.replace(made, tagged=False)

    @rule(device=DEVICE, days=st.integers(0, 40), simulated=SIMULATED)
    def certify(self, device: str, days: int, *, simulated: bool) -> None:
        done = DAY + timedelta(days=days)
        conditions = _conditions(simulated=simulated)
        self.store.add(Certificate(serial=device, issued=done, procedure="kvc", k_vc=CURVE, conditions=conditions))
        noise = Measured(value=1.0 + days, u=0.1)
        self.store.add(
            StaticNoise(
                serial=device,
                done=done,
                procedure="zero",
                bias_instability_deg_h=noise,
                duration_s=1.0,
                conditions=conditions,
            )
        )

    @rule(device=DEVICE, verdict=st.sampled_from(["pass", "fail"]), simulated=SIMULATED)
    def calibrate(self, device: str, verdict: Any, *, simulated: bool) -> None:
        store = DeviceStore(self.store.root, simulated)
        try:
            by = store.certificate(device)
        except ConfigError:
            assert self._last(device, Certificate, simulated=simulated) is None
            return
        assert by.record.conditions.simulated is simulated
        scale, bias = Measured(value=-0.0125, u=1e-6), Measured(value=-0.04, u=1e-5)
        self.store.add(
            SelfCalibration(
                serial=device,
                done=by.done + timedelta(days=1),
                procedure="self-calibration",
                certificate=by.name,
                scale_factor_v_per_deg_s=scale,
                bias_v=bias,
                conditions=_conditions(simulated=simulated),
                drift_verdict=verdict,
            )
        )

    @rule(device=DEVICE, which=st.integers(0))
    def withdraw(self, device: str, which: int) -> None:
        entries = self.store.entries(device)
        if not entries:
            return
        chosen = sorted(entries, key=lambda each: each.name)[which % len(entries)]
        if chosen.name in withdrawn(entries):
            with pytest.raises(ConfigError, match="withdrawn already"):
                self.store.withdraw(device, chosen.name, reason="R", by="B")
            return
        self.store.withdraw(device, chosen.name, reason="R", by="B")
        if chosen.run is None:
            self.gone.discard((device, chosen.record.withdraws))  # type: ignore[union-attr]
        else:
            self.gone.add((device, chosen.name))

    def _last(self, device: str, kind: type[DeviceRecord], *, simulated: bool) -> str | None:
        """Return the name of the newest entry of a kind, by its day, else by its number."""
        found = [
            (each.done, each.name)
            for each in self.store.entries(device)
            if isinstance(each.record, kind) and each.simulated is simulated and (device, each.name) not in self.gone
        ]
        return max(found)[1] if found else None

    def _changed(self, name: str, state: Any) -> bool:
        """Tell whether something was done since the invariant `name` was looked at."""
        before, self.looked[name] = self.looked.get(name), state
        return bool(before != state)

    @invariant()
    def a_device_is_done_by_the_last_whole_runs_that_its_plan_asks_for(self) -> None:
        if not self._changed("batch", tuple(self.made)):
            return
        for simulated, plan in self.plans.items():
            good = set()
            for device in DEVICES:
                own = [e for e in self.made if (e.device, e.simulated, e.asked) == (device, simulated, True)]
                last = {e.procedure: e.kind for e in own if e.whole}
                done = {name for name, kind in last.items() if kind not in self.fails}
                left = [each.procedure.name for each in plan.left(device, self.runs)]
                assert left == [name for name in ("turntable", "polarity") if name not in done]
                good |= set() if left else {device}
            self._sheet_shows(plan, good, simulated=simulated)

    def _sheet_shows(self, plan: Batch, good: set[str], *, simulated: bool) -> None:
        left_out = plan.left_out(self.runs)
        others = {e.path.name for e in self.made if e.tagged and not (e.asked and e.simulated is simulated)}
        assert set(left_out) == others
        rows = plan.rows(self.runs, {}, left_out)
        assert {row.simulated for row in rows} == {simulated}
        text = text_of(batch_sheet("b7", rows, left_out))
        tried = {row.device for row in rows if not row.waits}
        assert f"Yield: {len(good)} of {len(tried)} devices" in text or not tried
        panel = Panel(plan, self.runs)
        assert panel.shown()["left"] == [device for device in DEVICES if device not in good]
        for device in good:
            with pytest.raises(ConfigError, match="is measured already"):
                panel.name(device)

    @invariant()
    def a_certificate_has_the_days_of_its_readings_wherever_it_is_read(self) -> None:
        if not self._changed("days", (len(self.made), os.environ.get("TZ"))):
            return
        for made in (each for each in self.made if each.whole):
            assert days_of(vcfbench.load_run(made.path)) == tuple(day.isoformat() for day in made.days)

    @invariant()
    def a_drift_goes_by_its_own_certificate_and_world(self) -> None:
        if not self._changed("known", ([self.store.entries(device) for device in DEVICES], len(self.gone))):
            return
        for (simulated, plan), device in product(self.plans.items(), DEVICES):
            certificate = self._last(device, Certificate, simulated=simulated)
            asked = asked_in_python({"dut": device, "devices": str(self.store.root)})
            if certificate is None:
                with pytest.raises(ConfigError, match=r"no certificate|nothing is known"):
                    settings_of(SELF_CALIBRATION, plan.description, asked)
                continue
            known = settings_of(SELF_CALIBRATION, plan.description, asked).station.known
            assert known is not None
            assert known.certificate == certificate
            own = [
                (each.name, each.record.drift_verdict == "fail")
                for each in DeviceStore(self.store.root, simulated).standing(device)
                if isinstance(each.record, SelfCalibration) and each.record.certificate == certificate
            ]
            fails = [False, *(fail for _, fail in own), False]
            sure = [name for at, (name, fail) in enumerate(own, 1) if fail and (fails[at - 1] or fails[at + 1])]
            assert list(known.failed_before) == sure
            compared = [] if known.reference is None else [known.reference.name, *(each.name for each in known.history)]
            assert compared == [name for name, fail in own if not fail or name in sure]

    @invariant()
    def a_drift_is_between_runs_of_one_kind_of_bench(self) -> None:
        known = {each.device for each in self.made if each.whole}
        if not self._changed("drift", tuple(self.made)):
            return
        for device in known:
            seen = set()
            for row in device_rows(device, self.runs):
                assert (row.drift_ppm is not None) == (row.simulated in seen)
                seen.add(row.simulated)

    @invariant()
    def an_entry_counts_in_its_own_world_until_it_is_withdrawn(self) -> None:
        if not self._changed("store", [self.store.entries(device) for device in DEVICES]):
            return
        for device in DEVICES:
            entries = self.store.entries(device)
            assert [each.done for each in entries] == sorted(each.done for each in entries)
            for simulated in (True, False):
                store = DeviceStore(self.store.root, simulated)
                standing = {each.name for each in store.standing(device)}
                assert all(each.simulated is simulated for each in store.standing(device))
                assert not standing & {name for of, name in self.gone if of == device}
                noise = store.static_noise(device)
                assert (None if noise is None else noise.name) == self._last(device, StaticNoise, simulated=simulated)
                others = DeviceStore(self.store.root, not simulated).standing(device)
                assert all(each.name in store.left_out(device) for each in others)
            if entries:
                known = self.store.device(device)
                assert len({each.simulated for each in known.standing}) <= 1


def _own(line: Any) -> dict[str, Any]:
    """Return what a line says, without what its journal gives it."""
    return {key: value for key, value in line.items() if key not in {"type", "seal", "format"}}


def _conditions(*, simulated: bool) -> Conditions:
    return Conditions(bench="b", run="r", simulated=simulated, positive_rail_v=10.0, negative_rail_v=-10.0)


@pytest.mark.exhaustive
class TestMuchProvenance(Provenance.TestCase):
    """Some hundred steps; more are a matter of time."""

    settings = settings(max_examples=15, stateful_step_count=25, deadline=None, suppress_health_check=list(HealthCheck))
