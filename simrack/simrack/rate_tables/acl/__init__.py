"""The simulated ACUTROL3000: its language, what it is told and asked, and what it does of itself."""

from __future__ import annotations

from simrack.rate_tables.acl.instrument import AclTable, Header
from simrack.rate_tables.acl.limits import AxisLimits
from simrack.rate_tables.axis import TableErrors

__all__ = ["AclTable", "AxisLimits", "Header", "TableErrors"]
