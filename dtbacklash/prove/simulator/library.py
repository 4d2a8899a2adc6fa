"""The compiled inner loop of the concealing simulator; columns and entries of its arrays are named in ``machine.h``."""

from dtbacklash.core import build
from dtbacklash.core.binding import Binding

_simulator = Binding(build.SIMULATOR)
lib = _simulator.lib
buffer, copied, struct = _simulator.buffer, _simulator.copied, _simulator.struct
