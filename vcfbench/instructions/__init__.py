"""The work instruction: what a procedure is, its routines, the order of its rates, and what it knows beforehand."""
