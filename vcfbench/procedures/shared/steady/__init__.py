"""Steadiness of the output while a run went from setting to setting, and its response to them."""
