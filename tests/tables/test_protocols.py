"""What zaber, esp and atl say and hear, message by message."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

from vcfbench.drivers.rate_table.dialect import TableSettings
from vcfbench.drivers.rate_table.driver import RateTableDriver
from vcfbench.errors import FramingError, InstrumentError, InterlockError, LimitError, OutOfSync
from vcfbench.testing import expected_exchange, over_serial
from vcfbench_tables.atl import AtlDialect
from vcfbench_tables.esp import EspDialect
from vcfbench_tables.messages import checksum
from vcfbench_tables.zaber import ZaberDialect, frame_request, parse_reply

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.clock import VirtualClock
    from vcfbench.testing import Exchange, ScriptedWire

LIMITS = TableSettings(100.0, 50.0)


def driver(dialect: Any) -> Callable[[ScriptedWire, VirtualClock], RateTableDriver]:
    return over_serial(lambda line: RateTableDriver(line, dialect, LIMITS))


# Zaber


def zaber(*said: tuple[str, str]) -> list[Exchange]:
    """Number requests and replies as they come; ``*`` in front of a request is for the device and not the axis."""
    exchanges: list[Exchange] = []
    for number, (request, reply) in enumerate(said):
        axis, command = (0, request[1:]) if request.startswith("*") else (1, request)
        answer = f"@01 {axis} {number:02d} {reply}\r\n".encode()
        exchanges.append((frame_request(axis, number, command), answer))
    return exchanges


KNOWN = [
    ("*get deviceid", "OK IDLE -- 50081"),
    ("*get system.serial", "RJ IDLE -- BADCOMMAND"),
    ("*get version", "OK IDLE -- 7.33"),
]
STAGE = TableSettings(steps_per_deg=640000 / 360)


def test_zaber_golden_frames() -> None:
    assert frame_request(0, 0, "get deviceid") == b"/1 0 00 get deviceid:42\n"
    assert frame_request(1, None, "move vel 16384") == b"/1 1 move vel 16384:1A\n"
    assert parse_reply("@01 1 02 OK BUSY -- 0")["state"] == "BUSY"
    assert parse_reply("@01 1 03 RJ BUSY -- BADCOMMAND")["verdict"] == "RJ"


@pytest.mark.parametrize(
    "text",
    ["", "@01 1 OK", "@01 1 01 OK IDLE --", "@01 1 01 NO IDLE -- 0", "@01 1 01 OK IDLE -- 0:00", "/1 1 01 get pos"],
)
def test_what_is_no_reply_of_a_zaber_device(text: str) -> None:
    with pytest.raises(FramingError):
        parse_reply(text)


def test_zaber_rate_of_ten_deg_s() -> None:
    said = [*KNOWN, ("set accel 14", "OK IDLE -- 0"), ("move vel 29127", "OK BUSY -- 0"), ("stop", "OK BUSY -- 0")]
    with expected_exchange(driver(ZaberDialect(STAGE)), zaber(*said)) as table:
        table._enabled = True
        table.set_rate(10.0, 50.0)
        table.dialect.hold(table.line, table.line.deadline())


def test_zaber_reasons_and_warnings() -> None:
    said = [
        *KNOWN,
        ("warnings", "OK IDLE FS 03 FS WR FO"),
        ("get vel", "RJ IDLE -- BADAXIS"),
        ("warnings", "OK IDLE -- 00"),
    ]
    with expected_exchange(driver(ZaberDialect(STAGE)), zaber(*said)) as table:
        assert table.fault() == "stalled (FS)"
        with pytest.raises(InstrumentError, match=r"rejected \(BADAXIS: no such axis\)"):
            table.rate_deg_s()
        assert table.fault() is None


def test_zaber_answer_differs_from_late_alert_and_damaged_replies() -> None:
    exchanges = zaber(*KNOWN, ("get pos", "OK IDLE -- 0"), ("get pos", "OK IDLE -- 0"))
    noise = b"!01 1 IDLE --\r\n#01 0 hello\r\n@01 1 77 OK IDLE -- 999\r\n"
    exchanges[3] = (
        exchanges[3][0],
        noise + b"@01 1 03 OK IDLE -- 640000:%s\r\n" % checksum("lrc_hex", b"01 1 03 OK IDLE -- 640000"),
    )
    exchanges[4] = (exchanges[4][0], b"@01 1 04 OK IDLE -- 641000:00\r\n")
    exchanges.append((frame_request(1, 5, "get pos"), b"@01 1 05 OK IDLE -- 1\r\n"))
    with expected_exchange(driver(ZaberDialect(STAGE)), exchanges) as table:
        assert table.angle_deg() == 360.0
        assert table.angle_deg() == pytest.approx(360 / 640000)


@pytest.mark.parametrize("flag", [*(f"F{letter}" for letter in "BCDEFHMNPQRSTVZX"), "NC"])
def test_zaber_every_flag_of_a_fault_is_one(flag: str) -> None:
    said = (*KNOWN, ("warnings", f"OK IDLE {flag} 02 {flag} WR"), ("warnings", "OK IDLE FO 03 FO WR NI"))
    with expected_exchange(driver(ZaberDialect(STAGE)), zaber(*said)) as table:
        assert str(table.fault()).endswith(f"({flag})")
        assert table.fault() is None


def test_zaber_is_asked_by_the_name_that_its_firmware_knows() -> None:
    said = (("*get deviceid", "RJ IDLE -- BADCOMMAND"), ("*get device.id", "OK IDLE -- 50081"), *KNOWN[1:])
    with expected_exchange(driver(ZaberDialect(STAGE)), zaber(*said)):
        pass


def test_zaber_acceleration_that_would_mean_infinity() -> None:
    with (
        expected_exchange(driver(ZaberDialect(STAGE)), zaber(*KNOWN)) as table,
        pytest.raises(LimitError, match="below"),
    ):
        table.dialect.demand_rate(table.line, 1.0, 1.0, table.line.deadline())


# ESP


def esp(*said: tuple[str, str | None]) -> list[Exchange]:
    return [(f"{sent}\r".encode(), None if answer is None else f"{answer}\r\n".encode()) for sent, answer in said]


VERSION = ("VE?", "ESP301 Version 3.0.1 6/1/99")
DEGREES = ("1SN?", "7")
FINE = ("TB?", "0, 451322, NO ERROR DETECTED")


def test_esp_jog_and_stop() -> None:
    said = [
        VERSION,
        DEGREES,
        FINE,
        ("1AC20;1AG20;1VA10.5", None),
        FINE,
        ("1VA?", "10.5"),
        ("1MV+", None),
        FINE,
        ("1TV", "10.5"),
        ("1AC20;1AG20;1ST", None),
        FINE,
    ]
    with expected_exchange(driver(EspDialect(LIMITS)), esp(*said)) as table:
        table._enabled = True
        table.set_rate(10.5, 20.0)
        assert table.rate_deg_s() == 10.5
        table.stop(20.0)


def test_esp_stops_before_it_turns_the_other_way() -> None:
    said = [
        VERSION,
        DEGREES,
        FINE,
        ("1AC20;1AG20;1VA10", None),
        FINE,
        ("1VA?", "10"),
        ("1MV+", None),
        FINE,
        ("1AC20;1AG20;1ST", None),
        FINE,
        ("1AG?", "20"),
        ("1TV", "8"),
        ("1MD?", "0"),
        ("1MD?", "1"),
        ("1AC20;1AG20;1VA5", None),
        FINE,
        ("1VA?", "5"),
        ("1MV-", None),
        FINE,
    ]
    with expected_exchange(driver(EspDialect(LIMITS)), esp(*said)) as table:
        table._enabled = True
        table.set_rate(10.0, 20.0)
        table.set_rate(-5.0, 20.0)


def test_esp_refusals_are_raised_and_faults_kept() -> None:
    said = [
        VERSION,
        DEGREES,
        FINE,
        ("1VA10", None),
        ("TB?", "7, 451322, PARAMETER OUT OF RANGE"),
        ("TB?", "113, 451330, AXIS-1 MOTOR NOT ENABLED"),
        FINE,
        ("TB?", "110, 460000, AXIS-1 MAXIMUM VELOCITY EXCEEDED"),
        FINE,
        FINE,
    ]
    with expected_exchange(driver(EspDialect(LIMITS)), esp(*said)) as table:
        with pytest.raises(InstrumentError, match="refused with 7 PARAMETER OUT OF RANGE; then 113 AXIS-1") as caught:
            table.dialect.demand_rate(table.line, 10.0, float("inf"), table.line.deadline())
        assert caught.value.number == 7
        assert table.fault() == "overspeed (110 AXIS-1 MAXIMUM VELOCITY EXCEEDED)"
        with pytest.raises(InterlockError, match="overspeed"):
            table.enable()


def test_esp_finds_its_place_by_the_version() -> None:
    said = [
        VERSION,
        DEGREES,
        FINE,
        ("1TV", None),
        ("VE?", "3.5\r\nESP301 Version 3.0.1 6/1/99"),
        ("1MO?", "1"),
        ("1TV", "4.5"),
    ]
    with expected_exchange(driver(EspDialect(LIMITS)), esp(*said)) as table:
        assert table.rate_deg_s() == 4.5


def test_esp_reads_its_velocity_back_before_it_moves() -> None:
    said = [VERSION, DEGREES, FINE, ("1VA10", None), FINE, ("1VA?", "9.99")]
    with (
        expected_exchange(driver(EspDialect(LIMITS)), esp(*said)) as table,
        pytest.raises(InstrumentError, match=r"velocity of 10 but reads back 9\.99"),
    ):
        table.dialect.demand_rate(table.line, 10.0, float("inf"), table.line.deadline())


def test_esp_takes_a_velocity_above_its_limit_for_refused() -> None:
    said = [VERSION, DEGREES, FINE, ("1VA10", None), ("TB?", "110, 451322, AXIS-1 MAXIMUM VELOCITY EXCEEDED"), FINE]
    with (
        expected_exchange(driver(EspDialect(LIMITS)), esp(*said)) as table,
        pytest.raises(InstrumentError, match="refused with 110"),
    ):
        table.dialect.demand_rate(table.line, 10.0, float("inf"), table.line.deadline())


@pytest.mark.parametrize(("unit", "per_unit"), [("8", 0.9), ("9", 57.29577951), ("10", 0.05729577951)])
def test_esp_speaks_in_the_unit_that_was_left(unit: str, per_unit: float) -> None:
    velocity = f"{10.0 / per_unit:.6f}".rstrip("0").rstrip(".")
    said = [VERSION, ("1SN?", unit), FINE, (f"1VA{velocity}", None), FINE, ("1VA?", velocity), ("1MV+", None), FINE]
    with expected_exchange(driver(EspDialect(LIMITS)), esp(*said, ("1TV", f"{10.0 / per_unit}"))) as table:
        table.dialect.demand_rate(table.line, 10.0, float("inf"), table.line.deadline())
        assert table.rate_deg_s() == pytest.approx(10.0)


def test_esp_that_counts_in_lengths_is_refused() -> None:
    with (
        pytest.raises(InstrumentError, match="counts in unit 2, which is no angle"),
        expected_exchange(driver(EspDialect(LIMITS)), esp(VERSION, ("1SN?", "2"))),
    ):
        pass


# ATL

PROMPT = b"\r\n>\r\n"


def atl(*said: tuple[str, bytes | None]) -> list[Exchange]:
    return [(f"{sent}\r".encode(), answer) for sent, answer in said]


def test_atl_the_agreed_subset() -> None:
    said = [
        ("PPO", b"0.0000" + PROMPT),
        ("ACL20", PROMPT),
        ("JOG30", PROMPT),
        ("PVE", b"PVE30.0000" + PROMPT),
        ("ACL20", PROMPT),
        ("\rSTO", PROMPT),
    ]
    with expected_exchange(driver(AtlDialect(LIMITS)), atl(*said)) as table:
        table._enabled = True
        table.set_rate(30.0, 20.0)
        assert table.rate_deg_s() == 30.0
        table.stop(20.0)


def test_atl_missing_prompt_after_jog_is_replaced() -> None:
    said = [
        ("PPO", b"0.0000" + PROMPT),
        ("ACL20", PROMPT),
        ("JOG30", None),
        ("\rSTA", PROMPT + b"1" + PROMPT),
        ("ACL20", PROMPT),
        ("\rSTO", PROMPT),
    ]
    with expected_exchange(driver(AtlDialect(LIMITS)), atl(*said)) as table:
        table._enabled = True
        table.set_rate(30.0, 20.0)
        table.stop(20.0)


def test_atl_without_pve_watches_the_angle() -> None:
    said = [
        ("PPO", b"0.0000" + PROMPT),
        ("PVE", b"?" + PROMPT),
        ("PPO", b"359.0000" + PROMPT),
        ("PPO", b"2.0000" + PROMPT),
    ]
    with expected_exchange(driver(AtlDialect(LIMITS)), atl(*said)) as table:
        assert table.rate_deg_s() == pytest.approx(10.0)


def test_atl_stops_even_if_the_acceleration_is_refused() -> None:
    said = [("PPO", b"0.0000" + PROMPT), *[("ACL20", b"?" + PROMPT), ("\rSTO", PROMPT)] * 3]
    with (
        expected_exchange(driver(AtlDialect(LIMITS)), atl(*said)) as table,
        pytest.raises(InstrumentError, match=r"refused"),
    ):
        table.stop(20.0)


def test_atl_silence_closes_the_line() -> None:
    said = [("PPO", b"0.0000" + PROMPT), ("PVE", None), ("\rSTA", None)]
    with expected_exchange(driver(AtlDialect(LIMITS)), atl(*said)) as table, pytest.raises(OutOfSync):
        table.rate_deg_s()


def test_esp_ignores_refusals_of_other_clients() -> None:
    """Who looks for tables asks in other languages; what that left in the queue ended the first run."""
    left = ("TB?", "6, 451322, COMMAND DOES NOT EXIST")
    said = [VERSION, DEGREES, left, left, FINE, ("1ST", None), FINE, ("1MO", None), FINE]
    with expected_exchange(driver(EspDialect(LIMITS)), esp(*said)) as table:
        table.dialect.close_servo(table.line, table.line.deadline())
