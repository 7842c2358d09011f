from __future__ import annotations

from io import BytesIO
from pathlib import Path

import pytest

from vcfbench.analysis.csv_table import Layout
from vcfbench.archive.analyzed import read_table
from vcfbench.errors import BenchError, ConfigError
from vcfbench.records.export import points_csv, write_text
from vcfbench.records.schema import Point


def points(step: int) -> list[Point]:
    return [Point(step, rate, 0.0, -0.0125 * rate - 1.0 / 3.0, 1e-4, 10) for rate in (200.0, 0.0, -200.0)]


def test_points_are_read_back_to_last_digit() -> None:
    both = [*points(3), *points(4)]
    series = read_table(BytesIO(points_csv(both).encode()), "points.csv", Layout(), [])
    assert list(series) == ["turntable", "virtual"]
    assert series["turntable"].output.tolist() == [point.output_v for point in points(3)]


def test_points_survive_json() -> None:
    assert [Point.from_json(point.as_json()) for point in points(3)] == points(3)


def test_a_file_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(BenchError, match="the journal is complete: free space, then export again"):
        write_text(tmp_path, "x")


def test_full_disk_leaves_no_partial_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its first lines alone would be read as a table of fewer points."""
    written = Path.write_bytes

    def half(path: Path, data: bytes) -> int:
        written(path, data[: len(data) // 2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", half)
    with pytest.raises(BenchError, match=r"points\.csv cannot be written: No space left on device"):
        write_text(tmp_path / "points.csv", "step,rate_deg_s\n1,10.0\n1,0.0\n")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("value", [2e15, -2e15, float("nan"), float("inf"), 9.9e37])
def test_unreadable_point_is_refused(value: float) -> None:
    with pytest.raises(ConfigError, match="output_v: expected a number within"):
        Point(1, 10.0, 0.0, value, 1e-6, 10)
