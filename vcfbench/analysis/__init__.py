"""Pure functions on arrays: regression, non-linearity, Allan deviation."""
