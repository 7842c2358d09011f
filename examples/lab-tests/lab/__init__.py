"""Procedures of our lab."""
