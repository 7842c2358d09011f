"""What the paper prints: Wang, Cao, Shen, Chai, Micromachines 9 (2018); table 1, equations 17, 18, section 4.2."""

from __future__ import annotations

from typing import Final

RATES_DEG_S: Final = (200, 100, 50, 20, 10, 5, 2, 1, 0, -1, -2, -5, -10, -20, -50, -100, -200)
TURNTABLE_V: Final = (
    *(-2.5536, -1.2970, -0.6690, -0.2925, -0.1672, -0.1043, -0.0666, -0.0541, -0.0418),
    *(-0.0290, -0.0164, 0.0214, 0.0842, 0.2101, 0.5862, 1.2127, 2.4622),
)
VIRTUAL_V: Final = (
    *(-2.5626, -1.2791, -0.6352, -0.2517, -0.1215, -0.0496, -0.0199, -0.0074, 0.0099),
    *(0.0187, 0.0313, 0.0661, 0.1309, 0.2509, 0.6300, 1.2645, 2.5359),
)
"""Table 1 as printed, V."""

DRIVE_HZ, SENSE_HZ, DRIVE_Q, SENSE_Q = 3488.9, 3464.1, 1395.0, 1224.0
"""Measured modes, section 4.2."""
FIGURE_2_HZ = {"drive in phase": 2623.0, "sense in phase": 3342.0, "sense": 3468.0, "drive": 3484.0}
"""Computed modes, figure 2."""
