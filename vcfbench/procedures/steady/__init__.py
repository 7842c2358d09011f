"""Whether the output stood still while a run went from setting to setting, and whether it answered to them."""
