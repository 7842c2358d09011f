"""Single-axis rate tables on a serial line: one driver, one file a dialect."""
