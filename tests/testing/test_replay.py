"""A trace of a simulated session is a test of the driver."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from vcfbench.bench.bench import open_bench
from vcfbench.drivers.hp34401a import Hp34401A
from vcfbench.drivers.rate_table.acl import AclDialect
from vcfbench.drivers.rate_table.dialect import TableSettings
from vcfbench.drivers.rate_table.driver import RateTableDriver
from vcfbench.drivers.trace import HEADER, traced
from vcfbench.errors import ConfigError, DeadlineExceeded
from vcfbench.testing import over_serial, over_visa, read_trace, replay_trace

if TYPE_CHECKING:
    from pathlib import Path

    from vcfbench.drivers.rate_table.line import TableLine


@pytest.fixture(scope="module")
def trace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("trace") / "session.trace"
    with traced(path), open_bench(seed=1) as bench:
        bench.multimeter.configure_dc_voltage(10.0, 10.0)
        bench.multimeter.read_voltage_v()
        bench.rate_table.enable()
        bench.rate_table.set_rate(10.0, 100.0)
        while not bench.rate_table.at_rate():
            bench.clock.sleep_until(bench.clock.now() + 0.1)
    return path


def table(line: TableLine) -> RateTableDriver:
    return RateTableDriver(line, AclDialect(TableSettings()), TableSettings(300.0, 200.0))


def test_replay_repeats_messages_and_replies(trace: Path) -> None:
    with replay_trace(trace, over_visa(Hp34401A), role="multimeter", whole=False) as again:
        again.identify()
        again.configure_dc_voltage(10.0, 10.0)
        assert abs(again.read_voltage_v()) < 0.1


def test_so_does_a_table(trace: Path) -> None:
    with replay_trace(trace, over_serial(table), role="rate_table", whole=False) as again:
        again.identify()
        assert again.rate_deg_s() == 0.0
        again.enable()
        again.set_rate(10.0, 100.0)
        assert not again.at_rate()


def test_who_asks_otherwise_is_told(trace: Path) -> None:
    def on_another_range() -> None:
        with replay_trace(trace, over_visa(Hp34401A), role="multimeter") as again:
            again.identify()
            again.configure_dc_voltage(1.0, 10.0)

    said = r"^CONF:VOLT:DC 1\\n was sent; in the trace there is at 0.\d+ s: > CONF:VOLT:DC 10\\n$"
    with pytest.raises(AssertionError, match=said):
        on_another_range()


def test_who_asks_less_is_told(trace: Path) -> None:
    with (
        pytest.raises(AssertionError, match=r"of the trace's messages were not sent: "),
        replay_trace(trace, over_visa(Hp34401A), role="multimeter") as again,
    ):
        again.identify()


def test_the_role_must_be_in_it(trace: Path) -> None:
    with (
        pytest.raises(ConfigError, match=r"role 'chamber': expected one of power, rate_source"),
        replay_trace(trace, over_visa(Hp34401A), role="chamber"),
    ):
        pytest.fail("it was opened")


def test_a_time_out_comes_again_at_its_time(tmp_path: Path) -> None:
    path = tmp_path / "x.trace"
    lines = ("0.5\tm\tx\topen\tgpib", "1.0\tm\tx\t>\t*IDN?\\n", "3.0\tm\tx\t!\tDeadlineExceeded no answer")
    path.write_text("\n".join((HEADER, *lines, "")), "ascii")
    with replay_trace(path, over_visa(lambda session: session)) as session:
        with pytest.raises(DeadlineExceeded, match="no answer"):
            session.query("*IDN?")
        assert session.clock.now() == 3.0


@pytest.mark.parametrize(
    ("text", "words"),
    [("else", "expected a trace"), (f"{HEADER}\n1.0\tx", ":2: expected seconds, role"), (f"{HEADER}\n", "it is empty")],
)
def test_what_is_no_trace_is_said(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "x.trace").write_text(text, "ascii")
    with (
        pytest.raises(ConfigError, match=words),
        replay_trace(tmp_path / "x.trace", over_visa(lambda session: session)),
    ):
        pytest.fail("it was opened")


def test_a_simulated_bench_gives_the_same_trace_again(trace: Path, tmp_path: Path) -> None:
    def short(path: Path) -> str:
        with traced(path), open_bench(seed=1) as bench:
            bench.multimeter.configure_dc_voltage(10.0, 10.0)
            bench.multimeter.read_voltage_v()
        return path.read_text("ascii")

    assert short(tmp_path / "a") == short(tmp_path / "b")
    assert {line.role for line in read_trace(trace)} == {
        "power",
        "rate_source",
        "multimeter",
        "oscilloscope",
        "rate_table",
    }
