"""What `simrack_tests.cells` has, for the tests beside."""

from simrack_tests.cells import few

__all__ = ["few"]
