"""A sweep over rates: in which order, whether its points agree, what its windows show."""
