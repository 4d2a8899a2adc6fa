"""What backs the claims: campaigns, comparisons, measured speed, and the pages of the docs that they make."""

from dtbacklash.cli import one_blas_thread

one_blas_thread()
