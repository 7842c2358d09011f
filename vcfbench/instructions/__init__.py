"""Common work of procedures: the class Procedure, routines, order of rates, and results of earlier runs."""
