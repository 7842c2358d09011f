"""Plausibility of readings: agreement of points, jumps, walks, and the faults that a run cannot see."""
