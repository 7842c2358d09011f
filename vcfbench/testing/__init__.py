"""Helpers for the tests of drivers and procedures, here and in other projects."""
