"""The kit that records how real instruments answer, and the comparison with its records."""
