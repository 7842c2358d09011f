"""Validation of the program by the laboratory that uses it (ISO/IEC 17025:2017, 7.11.2)."""
