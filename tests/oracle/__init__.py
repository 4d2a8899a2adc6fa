"""What the core computes, by other means: the steps that numba compiles, and recursions written out in numpy."""
