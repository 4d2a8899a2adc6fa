"""An independent solution of a rig's equations of motion, for the tests only: slow, accurate, and plain.

It shares with the package the description of a rig (names and numbers), and nothing else: the equations stand
here once more, body by body as Newton would write them, and SciPy integrates them.
"""

from .solve import Solution, solve

__all__ = ["Solution", "solve"]
