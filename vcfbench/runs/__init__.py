"""A run under way: requested, prepared, conducted, paused, taken up again."""
