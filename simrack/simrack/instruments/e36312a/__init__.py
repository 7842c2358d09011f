"""The simulated E36312A triple supply."""

from __future__ import annotations

from simrack.instruments.e36312a.instrument import Errors36312A
from simrack.instruments.e36312a.twin import E36312ATwin

__all__ = ["E36312ATwin", "Errors36312A"]
