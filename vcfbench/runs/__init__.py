"""Runs from Python: a procedure on a bench, from the bench file to the record, and records read back.

The command line parses and prints; what a run is, is here.
"""
