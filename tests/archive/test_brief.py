"""The answer of a run on one screen."""

from __future__ import annotations

import vcfbench
from vcfbench.archive.brief import brief
from vcfbench.reports.text import text_of


def test_values_have_u95_and_causes() -> None:
    report = brief(vcfbench.run("turntable", seed=3, settings={"rates_deg_s": [10, 0, -10], "samples": 3}, runs=None))
    assert report is not None
    text = text_of(report, 80)
    assert "quantity " in text.splitlines()[0]
    assert "U95 of scale factor: " in text


def test_run_without_u95_has_no_brief() -> None:
    assert brief(vcfbench.run("polarity", seed=3, settings={"samples": 3}, runs=None)) is None
