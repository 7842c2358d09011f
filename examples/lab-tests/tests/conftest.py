"""What the lab's tests share. The fixtures of vcfbench are there without being imported."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from lab.zero_rate import ZeroRate, zero_rate

if TYPE_CHECKING:
    from vcfbench.bench.bench import Bench


@pytest.fixture
def measured(simulated_bench: Bench) -> ZeroRate:
    """What the procedure measures on an undisturbed bench."""
    return zero_rate(simulated_bench)
