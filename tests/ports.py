"""What `simrack_tests.ports` has, for the tests beside."""

from simrack_tests.ports import BUSY_S, PLENTY_S, eventually, free_port

__all__ = ["BUSY_S", "PLENTY_S", "eventually", "free_port"]
