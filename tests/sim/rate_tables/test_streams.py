"""Status that comes unasked: late and lost, as far as the bench file says."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from simrack.attendance import AttendedClock
from simrack.rate_tables.aaaa import AaaaTable
from simrack.rate_tables.axis import TableErrors
from simrack.rate_tables.ruya import RuyaTable
from simrack.rate_tables.stream import StreamErrors
from simrack_tests.rate_tables.ideal import IdealWorld

from vcfbench.bench.bench import open_bench
from vcfbench.errors import ConfigError
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.station.file import embedded_text

if TYPE_CHECKING:
    from collections.abc import Sequence

PERIOD_S, OWN_S = 0.1, 0.001
RUYA = embedded_text("ideal").replace('dialect = "acl"', 'dialect = "ruya"')


def with_errors(errors: str) -> str:
    return RUYA.replace('rate_table = "none"', f"rate_table = {{ {errors} }}")


def with_stream(jitter_s: float = 0.0, lost: float = 0.0) -> StreamErrors:
    return StreamErrors(0.0, 0.0, 0.0, 0.0, stream_jitter_s=jitter_s, stream_lost=lost)


def listened(table: Any, world: IdealWorld, seconds: float) -> list[tuple[float, bytes]]:
    """Return when each status came, and what."""
    clock = AttendedClock(world.clock, [table])
    found = list[tuple[float, bytes]]()
    until_s = clock.now() + seconds
    while clock.now() < until_s:
        clock.sleep_until(min(table.wake_at() or until_s, until_s))
        while data := table.read(1000)[0]:
            found.append((clock.now(), data))
    return found


def sequence(statuses: Sequence[tuple[float, bytes]]) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Return the numbers of the statuses, counted on beyond 99."""
    numbers = np.array([int(data[4:6]) for _, data in statuses])
    return np.cumsum(np.r_[numbers[0], np.diff(numbers) % 100])


def test_without_imperfections_each_comes_at_its_instant() -> None:
    world = IdealWorld()
    found = listened(RuyaTable(world, with_stream()), world, 10.0)
    assert [instant for instant, _ in found] == pytest.approx(PERIOD_S * np.arange(1, 100) + OWN_S)


def test_each_is_late_by_a_time_of_its_own() -> None:
    """Equally likely up to the jitter: a mean of half, a standard deviation of 1/sqrt(12), nothing beyond."""
    world = IdealWorld()
    found = listened(RuyaTable(world, with_stream(jitter_s=0.04), noise_seed=3), world, 200.0)
    late_s = np.array([instant for instant, _ in found]) - PERIOD_S * sequence(found) - OWN_S
    assert late_s.min() >= -1e-9
    assert late_s.max() <= 0.04 + 1e-9
    n = len(late_s)
    sigma_s = 0.04 / np.sqrt(12.0)
    assert late_s.mean() == pytest.approx(0.02, abs=4.0 * sigma_s / np.sqrt(n))
    assert late_s.std() == pytest.approx(sigma_s, rel=0.1)
    assert abs(np.corrcoef(late_s[1:], late_s[:-1])[0, 1]) < 4.0 / np.sqrt(n)


def test_a_late_status_says_what_was_at_its_instant() -> None:
    world = IdealWorld()
    table = RuyaTable(world, with_stream(jitter_s=0.09))
    table.write(b"$1mo=1\r\n")
    listened(table, world, 0.5)
    table.write(b"$13110000050.0000\r\n")
    listened(table, world, 2.0)
    found = listened(table, world, 3.0)
    angles_deg = np.array([float(data[6:14]) for _, data in found])
    steps = np.diff(sequence(found))
    assert np.ptp([instant % PERIOD_S for instant, _ in found]) > 0.05
    assert -np.diff(angles_deg) % 360.0 == pytest.approx(50.0 * PERIOD_S * steps, abs=2e-4)


@pytest.mark.parametrize("lost", [0.1, 0.5])
def test_so_many_are_lost_and_their_numbers_with_them(lost: float) -> None:
    world = IdealWorld()
    found = listened(RuyaTable(world, with_stream(lost=lost), noise_seed=1), world, 200.0)
    share = 1.0 - len(found) / 1999
    assert share == pytest.approx(lost, abs=4.0 * np.sqrt(lost * (1.0 - lost) / 1999))
    assert sequence(found)[-1] - sequence(found)[0] > len(found)
    assert [instant for instant, _ in found] == pytest.approx(PERIOD_S * sequence(found) + OWN_S)


def test_frames_too() -> None:
    world = IdealWorld()
    assert listened(AaaaTable(world, with_stream(lost=1.0)), world, 10.0) == []
    world = IdealWorld()
    assert 30 < len(listened(AaaaTable(world, with_stream(jitter_s=0.1, lost=0.5)), world, 10.0)) < 70


def test_another_seed_loses_others_and_the_same_the_same() -> None:
    runs = []
    for seed in (5, 5, 6):
        world = IdealWorld()
        runs.append(listened(RuyaTable(world, with_stream(0.02, 0.5), noise_seed=seed), world, 20.0))
    assert runs[0] == runs[1] != runs[2]


def test_they_are_changed_from_outside() -> None:
    world = IdealWorld()
    table = RuyaTable(world, TableErrors.none())
    change = {each.name: each for each in table.adjustments()}
    for name in ("stream.jitter_s", "stream.lost"):
        assert change[name].read() == 0.0
        assert change[name].write is not None
        for wrong in (-0.1, 1.1, "much", True):
            with pytest.raises(ValueError, match="a number at least 0"):
                change[name].write(wrong)
    change["stream.lost"].write(1)  # type: ignore[misc]
    assert listened(table, world, 5.0) == []


@pytest.mark.parametrize("errors", ["stream_jitter_s = 0.11", "stream_lost = -0.1", "stream_lost = 2.0"])
def test_a_bench_file_says_no_more_than_there_is(errors: str) -> None:
    with pytest.raises(ConfigError, match="a number at least 0"):
        parse_bench(with_errors(errors), "bench")


def test_a_table_that_loses_every_third_status_is_turned() -> None:
    text = with_errors("stream_jitter_s = 0.01, stream_lost = 0.3")
    with open_bench(parse_bench(text, "bench")) as bench:
        table = bench.rate_table
        assert table is not None
        table.enable()
        table.set_rate(20.0, 100.0)
        while not table.at_rate():
            bench.clock.sleep_until(bench.clock.now() + 0.1)
        assert table.rate_deg_s() == pytest.approx(20.0, rel=0.1)  # 10 ms of 0.25 s, twice
