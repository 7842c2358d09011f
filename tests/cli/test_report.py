"""``vcfbench report``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import vcfbench
from tests import warm
from tests.archive.test_written import QUICK

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A directory with one run in it."""
    folder = tmp_path_factory.mktemp("reports")
    vcfbench.run("turntable", seed=3, settings=QUICK, runs=folder / "runs")
    return folder


def test_the_last_run_is_reported_unasked_into_a_file_of_its_name(folder: Path) -> None:
    done = warm.run(["vcfbench", "report"], folder)
    (run,) = (folder / "runs").iterdir()
    assert (done.returncode, done.stdout) == (0, f"{run.name}.html\n"), done.stderr
    assert (folder / f"{run.name}.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_files_are_named_as_they_are_written(folder: Path) -> None:
    done = warm.run(["vcfbench", "report", "last", "-o", "mine.md"], folder)
    assert done.stdout.split() == ["mine.md", "mine-1.svg", "mine-2.svg"]


def test_what_is_not_there_is_said(folder: Path) -> None:
    done = warm.run(["vcfbench", "report", "none"], folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert "there is no run 'none'" in done.stderr


def test_figures_are_drawn_alone_or_all(folder: Path) -> None:
    drawn = warm.run(["vcfbench", "plot", "-o", "fig.png"], folder)
    assert drawn.stdout.split() == ["fig-1.png", "fig-2.png"], drawn.stderr
    drawn = warm.run(["vcfbench", "plot", "last", "--figure", "2", "-o", "residuals.svg"], folder)
    assert drawn.stdout.split() == ["residuals.svg"]
    assert "residual of full scale / ppm" in (folder / "residuals.svg").read_text(encoding="utf-8")
    refused = warm.run(["vcfbench", "plot", "--figure", "3"], folder)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "expected a figure from 1 to 2, came 3" in refused.stderr
