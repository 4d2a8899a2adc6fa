"""Fits by simulation: what may move, the least-squares problem, intervals, and the comparison of two fits."""
