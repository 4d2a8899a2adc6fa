"""The compiled core as it is loaded, and arrays as it takes them."""

from dtbacklash.core import build
from dtbacklash.core.binding import Binding

_core = Binding(build.CORE)
ffi, lib = _core.ffi, _core.lib
buffer, copied, struct, Calls = _core.buffer, _core.copied, _core.struct, _core.calls
#: law of ``laws.c`` -> its slot, the states that it asks for, its parameters by place
LAWS: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = _core.declared.LAWS
