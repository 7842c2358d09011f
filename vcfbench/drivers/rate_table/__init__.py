"""The rate-table driver and its dialects."""
