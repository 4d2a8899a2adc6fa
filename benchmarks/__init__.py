"""How fast the simulation is, beside other ways to do the same, and how safe the guarded twin."""

from dtbacklash.cli import one_blas_thread

one_blas_thread()
