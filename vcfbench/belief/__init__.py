"""Whether readings can be believed: agreement of points, jumps, walks, and the faults that a run cannot see."""
