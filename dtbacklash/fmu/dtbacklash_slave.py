"""The script inside of an FMU: it says what is wrong where the FMU is imported.

pythonfmu's library runs it once more at each instantiation, and then gives back a reference to its namespace that it
has not taken (https://github.com/NTNU-IHB/PythonFMU/issues/228): without one more, Python crashes at its next use.
"""

import ctypes
import sys

ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))

try:
    from dtbacklash.fmu.slave import RigSlave as Fmi2Slave
except ImportError as error:
    # importers show the log on demand only
    needs = "this FMU needs the Python package dtbacklash, in the version that stands in its description"
    print(f"{needs} (pip install dtbacklash): {error}", file=sys.stderr, flush=True)
    raise


class Rig(Fmi2Slave):
    """The rig whose description lies beside this file."""
