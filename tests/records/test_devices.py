"""What is known of each gyroscope: certificates and self-calibrations, only ever added, whole or not at all."""

from __future__ import annotations

import json
import math
import threading
from dataclasses import FrozenInstanceError
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from tests.characters import CHARACTERS
from vcfbench.errors import ConfigError
from vcfbench.records.device_values import Characteristics, Conditions, Measured
from vcfbench.records.devices import FORMAT, Certificate, DeviceStore, KvcCurve, SelfCalibration, together

NOON = datetime(2026, 11, 22, 12, 0, tzinfo=UTC)
CURVE = KvcCurve(
    coefficients=(0.01, 150.0, 0.2),
    covariance=((1e-6, 0.0, 0.0), (0.0, 4e-4, 1e-5), (0.0, 1e-5, 1e-4)),
    v_vc_min_v=-1.4,
    v_vc_max_v=1.4,
)
CONDITIONS = Conditions(
    bench="paper",
    run="20261122T120000Z-kvc-0a1b2c",
    simulated=True,
    positive_rail_v=10.0,
    negative_rail_v=-10.0,
    temperature_c=25.0,
    instruments={"multimeter": "HEWLETT-PACKARD,34401A,0,10-5-2"},
)
CERTIFICATE = Certificate(
    serial="G-0042",
    issued=NOON,
    valid_until=NOON + timedelta(days=365),
    procedure="kvc",
    k_vc=CURVE,
    conditions=CONDITIONS,
    scale_factor_v_per_deg_s=Measured(value=-0.0125, u=2e-7, dof=16.0),
    unseen=("a change of the comb's width",),
)
SELF = SelfCalibration(
    serial="G-0042",
    done=NOON + timedelta(days=30),
    procedure="self-calibration",
    certificate="0001",
    scale_factor_v_per_deg_s=Measured(value=-0.01251, u=5e-7),
    bias_v=Measured(value=-0.042, u=1e-5),
    conditions=CONDITIONS,
    drift_ppm=Measured(value=800.0, u=43.0),
    verdict="pass",
)


@pytest.fixture
def store(tmp_path: Path) -> DeviceStore:
    return DeviceStore(tmp_path / "devices")


def test_entries_come_back_unchanged_and_in_order(store: DeviceStore) -> None:
    assert store.serials() == ()
    assert store.entries("G-0042") == ()
    added = [store.add(record) for record in (CERTIFICATE, SELF, SELF)]
    assert [each.name for each in added] == ["0001", "0002", "0003"]
    assert store.entries("G-0042") == tuple(added)
    assert [each.record for each in store.entries("G-0042")] == [CERTIFICATE, SELF, SELF]
    assert store.certificate("G-0042").record == CERTIFICATE
    assert [e.name for e in store.entries("G-0042") if isinstance(e.record, SelfCalibration)] == ["0002", "0003"]
    store.add(structs.replace(CERTIFICATE, serial="A.1"))
    assert store.serials() == ("A.1", "G-0042")


def test_the_last_certificate_counts(store: DeviceStore) -> None:
    store.add(CERTIFICATE)
    store.add(SELF)
    newer = structs.replace(CERTIFICATE, issued=NOON + timedelta(days=60))
    store.add(newer)
    assert store.certificate("G-0042").record == newer


def test_a_certificate_is_valid_for_its_time(store: DeviceStore) -> None:
    del store
    assert CERTIFICATE.valid_at(NOON)
    assert not CERTIFICATE.valid_at(NOON - timedelta(seconds=1))
    assert not CERTIFICATE.valid_at(NOON + timedelta(days=366))
    assert structs.replace(CERTIFICATE, valid_until=None).valid_at(NOON + timedelta(days=36600))


def test_the_file_is_json_that_names_kind_and_format(store: DeviceStore) -> None:
    path = store.add(CERTIFICATE).path
    values = json.loads(path.read_text(encoding="utf-8"))
    assert (values["format"], values["kind"], values["serial"]) == (FORMAT, "certificate", "G-0042")
    assert values["k_vc"]["coefficients"] == [0.01, 150.0, 0.2]
    assert list(path.parent.iterdir()) == [path]


def test_nothing_is_written_over(store: DeviceStore) -> None:
    path = store.add(CERTIFICATE).path
    before = path.read_bytes()
    (path.parent / "0007.json").write_bytes(before)
    assert store.add(SELF).name == "0008"
    assert path.read_bytes() == before
    with pytest.raises((AttributeError, FrozenInstanceError)):
        CERTIFICATE.serial = "other"  # type: ignore[misc]


def test_programs_that_add_at_once_all_get_a_number(store: DeviceStore) -> None:
    def add() -> None:
        for _ in range(5):
            store.add(SELF)

    workers = [threading.Thread(target=add) for _ in range(6)]
    for each in workers:
        each.start()
    for each in workers:
        each.join()
    assert [each.name for each in store.entries("G-0042")] == [f"{number:04d}" for number in range(1, 31)]


def test_a_disk_that_takes_nothing_leaves_no_half_entry(store: DeviceStore, monkeypatch: pytest.MonkeyPatch) -> None:
    store.add(CERTIFICATE)

    def full(descriptor: int) -> None:
        del descriptor
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(ConfigError, match=r"G-0042: no entry can be kept there: No space left on device"):
        store.add(SELF)
    assert [each.name for each in (store.root / "G-0042").iterdir()] == ["0001.json"]


@pytest.mark.parametrize(
    "serial", ["", ".", "..", "a/b", "a\\b", "../x", "-x", "x.", "x..y", "con", "NUL.1", "a b", "ä", "a\n", "x" * 65]
)
def test_what_cannot_name_a_directory_is_no_serial_number(serial: str, store: DeviceStore) -> None:
    with pytest.raises(ConfigError, match="serial number"):
        store.add(structs.replace(CERTIFICATE, serial=serial))
    with pytest.raises(ConfigError, match="serial number"):
        store.entries(serial)
    assert not store.root.exists()


def test_two_devices_do_not_differ_in_case_alone(store: DeviceStore) -> None:
    store.add(CERTIFICATE)
    with pytest.raises(ConfigError, match="there is a device 'G-0042'; 'g-0042' differs in case alone"):
        store.add(structs.replace(CERTIFICATE, serial="g-0042"))


def test_a_device_without_a_certificate_says_which_there_are(store: DeviceStore) -> None:
    store.add(CERTIFICATE)
    with pytest.raises(
        ConfigError, match="device 'G-0043' has no certificate; known devices: G-0042; vcfbench run kvc"
    ):
        store.certificate("G-0043")


def change(**changes: Any) -> Any:
    def changed(values: dict[str, Any]) -> str:
        return json.dumps({**values, **changes})

    return changed


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda _: "", r"0001\.json: expected JSON"),
        (lambda values: json.dumps(values)[:-9], r"0001\.json: expected JSON"),
        (lambda _: "[]", "expected an entry of a device, with a key format"),
        (change(format=2), "expected format 1; it was written by another version"),
        (change(format=True), "expected an entry of a device"),
        (change(kind="letter"), "letter"),
        (change(colour="red"), "colour"),
        (change(issued="2026-11-22T12:00:00"), "issued"),
        (change(serial="G-0043"), "expected device 'G-0042', got 'G-0043'"),
        (change(k_vc={"coefficients": [1.0]}), "k_vc"),
        (change(k_vc={"coefficients": [0.0, 1.0], "covariance": [[1.0]], "v_vc_min_v": -1, "v_vc_max_v": 1}), "2 rows"),
        (change(scale_factor_v_per_deg_s={"value": 1.0, "u": -1.0}), ">= 0"),
    ],
)
def test_what_does_not_parse_is_refused_in_one_sentence(damage: Any, said: str, store: DeviceStore) -> None:
    path = store.add(CERTIFICATE).path
    path.write_text(damage(json.loads(path.read_text(encoding="utf-8"))), encoding="utf-8")
    with pytest.raises(ConfigError, match=said) as caught:
        store.entries("G-0042")
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_what_is_no_number_is_not_written(value: float, store: DeviceStore) -> None:
    broken = structs.replace(CERTIFICATE, scale_factor_v_per_deg_s=Measured(value=value, u=1.0))
    with pytest.raises(ConfigError, match="the certificate of G-0042"):
        store.add(broken)
    assert not store.root.exists()


def test_the_curve_tells_the_rate_where_it_was_measured() -> None:
    assert CURVE.rate_deg_s(1.0) == pytest.approx(150.21)
    assert CURVE.rate_deg_s(-1.0) == pytest.approx(-149.79)
    with pytest.raises(ValueError, match=r"V_Vc of 1\.5 V is outside of -1\.4 to 1\.4 V"):
        CURVE.rate_deg_s(1.5)


@pytest.mark.parametrize(
    "changes",
    [
        {"covariance": ((1.0, 0.0), (0.0, 1.0))},
        {"covariance": ((1.0, 2.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))},
        {"covariance": ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))},
        {"v_vc_min_v": 1.4},
        {"v_vc_min_v": -1e308},
        {"v_vc_max_v": 1e308},
        {"coefficients": (0.0, 1e308, 0.0)},
        {"covariance": ((1e308, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))},
    ],
)
def test_a_curve_whose_parts_do_not_fit_is_none(changes: dict[str, Any]) -> None:
    values: dict[str, Any] = {name: getattr(CURVE, name) for name in KvcCurve.__struct_fields__}
    with pytest.raises(ValueError, match="expected"):
        KvcCurve(**{**values, **changes})


def test_what_rounding_leaves_of_no_correlation_is_no_asymmetry() -> None:
    """As of the ideal bench, whose levels are symmetric."""
    covariance = ((1e-6, 3e-22, 0.0), (-1e-22, 4e-4, 1e-5), (0.0, 1e-5 * (1.0 + 1e-9), 1e-4))
    values: dict[str, Any] = {name: getattr(CURVE, name) for name in KvcCurve.__struct_fields__}
    assert KvcCurve(**{**values, "covariance": covariance}).covariance == covariance


FINITE = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=15)  # each writes two files through to the disk
@given(
    FINITE,
    FINITE.map(abs),
    st.datetimes(timezones=st.just(UTC)),
    st.lists(st.text(CHARACTERS, min_size=1, max_size=20)),
)
def test_any_number_instant_and_words_come_back(
    tmp_path_factory: pytest.TempPathFactory, value: float, u: float, instant: datetime, words: list[str]
) -> None:
    store = DeviceStore(tmp_path_factory.mktemp("any"))
    record = structs.replace(SELF, bias_v=Measured(value=value, u=u), done=instant, remarks=tuple(words))
    assert store.add(record).record == store.entries("G-0042")[0].record == record


def test_last_values_count_and_two_slopes_give_k_vc_slope() -> None:
    def measured(value: float, u: float = 3.0) -> Measured:
        return Measured(value=value, u=u)

    warm = Characteristics(temperature_c=measured(20.0), drive_hz=measured(3488.0), v_vc_slope_ppm_k=measured(-73.0))
    turned = Characteristics(table_slope_ppm_k=measured(-103.0, 4.0), split_hz=measured(24.8))
    found = together([warm, turned])
    assert found.k_vc_ppm_k == measured(30.0, 5.0)
    assert found.k_vc_ppm_v is None
    assert (found.temperature_c, found.drive_hz) == (measured(20.0), measured(3488.0))
    later = together([warm, turned, Characteristics(drive_hz=measured(3487.0))])
    assert (later.temperature_c, later.drive_hz) == (None, measured(3487.0))


REAL = structs.replace(CONDITIONS, simulated=False)


def test_real_and_simulated_entries_never_meet(store: DeviceStore) -> None:
    failed = structs.replace(SELF, drift_verdict="fail")
    store.add(CERTIFICATE)
    store.add(failed)
    assert store.device("G-0042").failed_since is not None  # as long as there is nothing else
    real = DeviceStore(store.root, simulated=False)
    with pytest.raises(ConfigError, match="has no certificate; device G-0042: left out, from a simulated bench: 0001"):
        real.certificate("G-0042")
    assert (real.static_noise("G-0042"), real.characteristics("G-0042")) == (None, None)
    own = store.add(structs.replace(CERTIFICATE, conditions=REAL, issued=NOON - timedelta(days=9)))
    assert real.certificate("G-0042") == own
    assert real.left_out("G-0042") == "device G-0042: left out, from a simulated bench: 0001, 0002"
    known = store.device("G-0042")
    assert (known.certificate, known.failed_since, known.standing) == (own.record, None, (own,))
    rehearsal = DeviceStore(store.root, simulated=True)
    assert rehearsal.certificate("G-0042").name == "0001"
    assert rehearsal.left_out("G-0042") == "device G-0042: left out, from a real bench: 0003"


def test_entries_are_sorted_by_day(store: DeviceStore) -> None:
    store.add(CERTIFICATE)
    store.add(structs.replace(CERTIFICATE, issued=NOON - timedelta(days=300)))
    assert [each.name for each in store.entries("G-0042")] == ["0002", "0001"]
    assert store.certificate("G-0042").name == "0001"


def test_withdrawn_entry_counts_again_after_withdrawing_withdrawal(store: DeviceStore) -> None:
    store.add(CERTIFICATE)
    store.add(structs.replace(SELF, drift_verdict="fail"))
    taken = store.withdraw("G-0042", "0002", reason="the leads were swapped", by="A. Person")
    assert taken.name == "0003"
    known = store.device("G-0042")
    assert (len(known.entries), known.failed_since, known.self_calibrations) == (3, None, ())
    for wrong, words in (("0002", "it is withdrawn already"), ("0009", "expected the name of an entry")):
        with pytest.raises(ConfigError, match=words):
            store.withdraw("G-0042", wrong, reason="why", by="who")
    with pytest.raises(ConfigError, match="expected a reason"):
        store.withdraw("G-0042", "0001", reason=" ", by="who")
    store.withdraw("G-0042", "0003", reason="it was the right device", by="A. Person")
    assert [each.name for each in store.standing("G-0042")] == ["0001", "0002"]


@pytest.mark.parametrize("change", ["removed", "changed"])
@pytest.mark.parametrize("name", ["0001", "0002", "0003"])
def test_change_before_a_withdrawal_is_found(store: DeviceStore, change: str, name: str) -> None:
    store.add(CERTIFICATE)
    store.add(SELF)
    store.withdraw("G-0042", "0002", reason="why", by="who")
    store.withdraw("G-0042", "0003", reason="why", by="who")
    store.add(SELF)
    path = store.root / "G-0042" / f"{name}.json"
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert len(store.entries("G-0042")) == 5  # as another system has it
    if change == "removed":
        path.unlink()
    else:
        path.write_text(path.read_text("utf-8").replace('"kind"', ' "kind"'), "utf-8")
    with pytest.raises(ConfigError, match="changed or removed since this was written"):
        store.entries("G-0042")


@pytest.mark.parametrize(("until", "beyond"), [(NOON, True), (NOON + timedelta(days=9), False), (None, False)])
def test_beyond_the_wanted_u95_and_never_are_two_things(until: datetime | None, *, beyond: bool) -> None:
    assert structs.replace(CERTIFICATE, wanted_u95_ppm=500.0, u95_until=until).beyond_u95 is beyond
