from __future__ import annotations

import pytest

from vcfbench.drivers.registry import DRIVERS
from vcfbench.testing import ConformanceCase, conformance_cases, conformance_problems

CASES = conformance_cases()


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.model)
def test_driver_conforms(case: ConformanceCase) -> None:
    assert conformance_problems(case) == []


def test_every_registered_driver_has_a_case() -> None:
    assert {case.model for case in CASES} == set(DRIVERS.drivers)
