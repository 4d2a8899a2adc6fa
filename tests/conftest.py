"""What all tests share."""

import gc

from hypothesis import settings

from dtbacklash.cli import GARBAGE_AFTER, one_blas_thread

# as the command line does: threads for tiny matrices, two tests at a time, only stand in each other's way
one_blas_thread()
gc.set_threshold(GARBAGE_AFTER)

# repeatable examples, and no deadlines: the first call of a compiled function compiles it
settings.register_profile("house", deadline=None, derandomize=True)
settings.load_profile("house")
