"""The simulated ACUTROL3000: its language, commands and queries, and its motion."""

from __future__ import annotations

from simrack.rate_tables.acl.instrument import AclTable, Header
from simrack.rate_tables.acl.limits import AxisLimits
from simrack.rate_tables.axis import TableErrors

__all__ = ["AclTable", "AxisLimits", "Header", "TableErrors"]
