"""Windows that do not scatter as the run does are refused, honest ones are not."""

from __future__ import annotations

import numpy as np
import pytest

from vcfbench.steps.scatter import NoiseSeen, Scatter

NOISE_V = 1.2e-4
RESOLUTION_V = 1e-5
WINDOWS, N = 43, 10
SETTLES = "it dies away from the first reading on, as what has not settled does (a longer settle_s)"


def honest(seed: int, *, warm_up_v: float = 0.0, flicker_v: float = 0.0) -> np.ndarray:
    """The windows of one run: white noise, flicker as a sum of octaves, the exponential of a warm-up, whole counts."""
    rng = np.random.default_rng(seed)
    count = WINDOWS * N
    readings = NOISE_V * rng.standard_normal(count) + warm_up_v * np.exp(-np.arange(count) / 200.0)
    for octave in range(9):
        readings += flicker_v / 3.0 * np.repeat(rng.standard_normal(count // 2**octave + 1), 2**octave)[:count]
    return (np.round(readings / RESOLUTION_V) * RESOLUTION_V).reshape(WINDOWS, N)


def first_doubt(windows: np.ndarray) -> str:
    seen = NoiseSeen(RESOLUTION_V)
    return next((said for window in windows if (said := seen.doubt(window.tolist()))), "")


@pytest.mark.parametrize("changes", [{}, {"flicker_v": 6e-5}, {"warm_up_v": 5e-3}])
def test_honest_runs_are_believed(changes: dict[str, float]) -> None:
    assert not [seed for seed in range(40) if first_doubt(honest(seed, **changes))]


def test_without_any_noise_nothing_is_doubted() -> None:
    assert first_doubt(np.full((WINDOWS, N), -0.0414)) == ""
    one_count = np.full((WINDOWS, N), -0.0414)
    one_count[20, 3] += RESOLUTION_V
    assert first_doubt(one_count) == ""


def test_a_table_may_ripple_under_a_gyroscope_without_noise() -> None:
    moved_v = np.linspace(2.5, -2.5, WINDOWS)
    ripple = 4e-5 * np.sin(np.arange(WINDOWS * N)).reshape(WINDOWS, N)
    readings = np.round(moved_v[:, None] * (1.0 + ripple) / RESOLUTION_V) * RESOLUTION_V

    def doubts(*, turning: bool) -> bool:
        seen = NoiseSeen(RESOLUTION_V)
        for _ in range(20):
            seen.doubt([0.0] * N)
        return any(seen.doubt(window.tolist(), turning=turning) for window in readings)

    assert not doubts(turning=True)
    assert doubts(turning=False)


@pytest.mark.parametrize("window", [0, 1, 20, 42])
@pytest.mark.parametrize("reading", [0, 4, 9])
@pytest.mark.parametrize("off_v", [-1.503, 0.5, 0.01, -0.0015])
def test_one_reading_in_ten_that_is_off_is_found(window: int, reading: int, off_v: float) -> None:
    windows = honest(1)
    windows[window, reading] += off_v
    assert first_doubt(windows)


def test_the_words_name_the_reading_and_the_numbers() -> None:
    windows = honest(1)
    windows[20, 3] -= 1.503
    said = first_doubt(windows)
    assert said.startswith("reading 4 of 10 is -1.5 V off the others, where one reading scatters by 0.000")


@pytest.mark.parametrize("since", [1, 5, 9])
def test_a_step_within_a_window_is_found(since: int) -> None:
    windows = honest(2)
    windows[7, since:] += 0.05
    assert first_doubt(windows)


def test_second_window_reveals_step_in_first() -> None:
    windows = honest(3)
    windows[0, 5:] += 0.05
    seen = NoiseSeen(RESOLUTION_V)
    assert [bool(seen.doubt(window.tolist())) for window in windows[:2]] == [False, True]


@pytest.mark.parametrize(
    ("added_v", "looks"),
    [
        (0.04 * np.exp(-np.arange(N) / 0.8), SETTLES),
        (0.04 * np.exp(-np.arange(N) / 2.0) * np.cos(3.0 * np.arange(N)), SETTLES),
        (np.where(np.arange(N) == 0, 0.005, 0.0), f"a step, for the first reading alone is off, or {SETTLES}"),
        (np.where(np.arange(N) == 4, 0.005, 0.0), "as a contact or a bump (leads, fixture)"),
        (np.where(np.arange(N) == 9, 0.005, 0.0), "as a contact or a bump (leads, fixture), or a step"),
        (np.where(np.arange(N) < 4, 0.0, -0.05), "it stepped by -0.05 V at reading 5 of 10, and stayed there"),
        (
            np.where((np.arange(N) > 2) & (np.arange(N) < 6), 0.005, 0.0),
            "off by +0.005 V from reading 4 to 6 of 10, and back, as a contact or a bump (leads, fixture)",
        ),
        (np.random.default_rng(1).normal(0.0, 0.005, N), ""),
    ],
    ids=["settling", "ringing", "first", "outlier", "last", "step", "contact", "noise"],
)
def test_scattering_window_names_likely_cause(added_v: np.ndarray, looks: str) -> None:
    windows = honest(1)
    windows[20] += added_v
    said = first_doubt(windows)
    assert said.partition(" V: ")[2] == looks
    assert " of the other windows by " in said or " off the others, where " in said


def test_readings_that_stand_still_where_others_scatter_are_no_measurement() -> None:
    windows = honest(4)
    windows[30] = 1e-6
    assert first_doubt(windows).endswith("a lead is off, the output is at its end, or the others were disturbed")


def test_quiet_window_hints_at_unsettled_others() -> None:
    """A gyroscope without noise behind a filter of 0.5 Hz, 3 s after a change of rate."""
    rings_uv = [-1918, -19, 176, -101, 43, -16, 5, -2, 1, 0]
    seen = NoiseSeen(RESOLUTION_V)
    assert seen.doubt([0.0] * N) == ""
    said = seen.doubt([1e-6 * each - 2.5084 for each in rings_uv], turning=True)
    assert said.startswith("window 1 of the run: the readings scatter by 0 V only")
    assert said.endswith(f": a lead is off, the output is at its end, or the others were disturbed: {SETTLES}")


@pytest.mark.parametrize("times", [0.5, 2.0])
def test_long_windows_at_another_rate_may_scatter_less_or_more(times: float) -> None:
    windows = np.random.default_rng(6).normal(0.0, 3e-5, (6, 200))
    windows[3] *= times
    assert not first_doubt(windows)


def test_noise_that_doubles_with_the_rate_is_believed() -> None:
    windows = honest(5)
    windows[20:] *= 2.0
    assert first_doubt(windows) == ""


def test_fewer_than_three_readings_tell_nothing_of_their_scatter() -> None:
    assert Scatter.of([1.0, 2.0]) is None
    assert first_doubt(np.array([[1.0, 2.0], [5.0, -7.0]])) == ""
    assert NoiseSeen(RESOLUTION_V).std_v is None


@pytest.mark.parametrize("disturbed", range(8))
def test_one_of_three_readings_that_is_far_off_is_seen(disturbed: int) -> None:
    windows = np.random.default_rng(7).normal(0.0, 3e-5, (8, 3))
    assert first_doubt(windows) == ""
    windows[disturbed, 1] += 0.06
    assert "reading" in first_doubt(windows)


def test_farthest_reading_is_compared_with_line_through_others() -> None:
    readings = [0.1 * i for i in range(10)]
    readings[6] += 1.0
    scatter = Scatter.of(readings)
    assert scatter is not None
    assert (scatter.n, scatter.degrees, scatter.farthest) == (10, 8, 7)
    assert scatter.distance_v == pytest.approx(1.0)
