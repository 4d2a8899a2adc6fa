"""The script inside of an FMU: it says what is wrong where the FMU is imported.

pythonfmu's library runs it once more at each instantiation, and then gives back a reference to its namespace that it
has not taken (https://github.com/NTNU-IHB/PythonFMU/issues/228): without one more, Python crashes at its next use.
"""

import contextlib
import ctypes
import glob
import os
import sys

ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))


def end_once(resources: str) -> None:
    """Let the library beside these resources give up its hold of Python once, not twice, when the process ends.

    On Linux its static pointer to that hold is destroyed among the process's exit functions, which does not empty it;
    later the library's own finalizer gives up the same hold once more, in memory that is free or somebody else's by
    then (``corrupted unsorted chunks`` in https://github.com/NTNU-IHB/PythonFMU/issues/228). The finalizer empties the
    pointer: as an exit function it runs before the destruction, because the last one that is registered runs first.
    Python's ``atexit`` would come after it where the library itself has started Python.
    """
    for file in glob.glob(os.path.join(glob.escape(os.path.dirname(resources)), "binaries", "linux64", "*.so")):
        # the builder runs the script with no library at all, and an importer may have loaded another file
        with contextlib.suppress(OSError, AttributeError):
            # never closed, so that the function is still there when the process ends
            library = ctypes.CDLL(file, mode=os.RTLD_NOLOAD)
            end = ctypes.cast(library.finalizePythonInterpreter, ctypes.c_void_p)
            # what C's atexit calls, which is itself in no shared library
            ctypes.CDLL(None).__cxa_atexit(end, None, None)


if sys.platform == "linux":
    # the library has put them there, and just now: __file__ is that of the first of several FMUs in a process
    end_once(sys.path[0])

try:
    from dtbacklash.fmu.slave import RigSlave as Fmi2Slave
except ImportError as error:
    # importers show the log on demand only
    needs = "this FMU needs the Python package dtbacklash, in the version that stands in its description"
    print(f"{needs} (pip install dtbacklash): {error}", file=sys.stderr, flush=True)
    raise


class Rig(Fmi2Slave):
    """The rig whose description lies beside this file."""
