"""Compiles the core: ``python -m dtbacklash.core.build``; the build backend does it for a wheel.

What Python may call is read off the C sources: each law (``double NAME(const SLOT *at, const double *p)``), and each
function whose name begins with ``dtb_``. So a function stands in one place, and the library knows nothing of Python.
"""

import hashlib
import importlib.util
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
from contextlib import redirect_stdout
from pathlib import Path

HERE = Path(__file__).parent
HEADERS = ("laws.h", "plant.h", "twin.h", "control.h", "loop.h", "external.h")
SOURCES = (
    "laws.c", "formula.c", "predict.c", "filter.c", "twin.c", "control.c", "indexes.c", "loop.c", "external.c",
    "model_exchange.c",
)  # fmt: skip
LIBRARY, DECLARED = "_core.so", "_declared.py"
#: no contraction of a product and a sum into one rounding: results are those of any other compiler
FLAGS = ["-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared"]
#: GCC's: loops run over a few states as they are written, not in vectors with a rest, nor as calls of memset
LOOPS = ["-fno-tree-loop-vectorize", "-fno-tree-loop-distribute-patterns"]
#: a law: its name, its slot, its parameters one by one or as a row, and what stands in it
_LAW = re.compile(r"^double (\w+)\(const (\w+) \*at, const double \*(p|row)\)\s*\{(.*?)\}\n(?:\n|\Z)", re.M | re.DOTALL)
_CALLED = re.compile(r"^\w+ dtb_\w+\([^{;]*\)(?=\n?\s*\{)", re.MULTILINE)


def digest() -> str:
    """Hash of what decides the library: sources, flags and platform, 16 hexadecimal digits."""
    files = sorted(file for kind in ("*.c", "*.h", "build.py") for file in HERE.glob(kind))
    said = [*(file.read_bytes() for file in files), " ".join(FLAGS + LOOPS).encode(), sysconfig.get_platform().encode()]
    return hashlib.sha256(b"".join(said)).hexdigest()[:16]


def is_current() -> bool:
    """Whether the library that is there was made of these sources."""
    declared = HERE / DECLARED
    there = declared.is_file() and (HERE / LIBRARY).is_file()
    return there and declared.read_text(encoding="utf-8").endswith(f"SOURCES = {digest()!r}\n")


def laws() -> dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]]:
    """Law -> its slot, the states that it asks for, and its parameters by place, empty where it asks for another."""
    found = {}
    for name, slot, row, body in _LAW.findall((HERE / "laws.c").read_text(encoding="utf-8")):
        places = {int(place): own for own, place in re.findall(r"(\w+) = p\[(\d+)\]", body)}
        parameters = tuple(places.get(k, "") for k in range(max(places, default=-1) + 1))
        states = tuple(dict.fromkeys(re.findall(r"at->(\w+)", body)))
        found[name] = slot, states, ("row",) if row == "row" else parameters
    return found


def declarations() -> str:
    """What Python sees: the structs, the laws, and the functions that it calls."""
    texts = {name: (HERE / name).read_text(encoding="utf-8") for name in (*HEADERS, *SOURCES)}
    called = [one for name in SOURCES for one in _CALLED.findall(texts[name])]
    named = [f"double {name}(const {slot} *at, const double *p)" for name, (slot, _, _) in laws().items()]
    return "\n".join([*(texts[name] for name in HEADERS), *(f"{one};" for one in (*named, *called))])


def compiler() -> list[str]:
    """``$CC``, cc, or the compiler in the package ziglang; empty where there is none of them."""
    if chosen := os.environ.get("CC"):
        return shlex.split(chosen)
    if shutil.which("cc"):
        return ["cc"]
    return [sys.executable, "-m", "ziglang", "cc"] if importlib.util.find_spec("ziglang") else []


def flags(chosen: list[str]) -> list[str]:
    """The flags for a compiler; some refuse what only GCC knows."""
    tried = subprocess.run(
        [*chosen, *LOOPS, "-Werror", "-fsyntax-only", "-x", "c", os.devnull], capture_output=True, check=False
    )
    return FLAGS if tried.returncode else FLAGS + LOOPS


def make() -> None:
    """Compile the library, and write down what is in it, beside the sources; not if it is there already.

    Raises SystemExit, with one line, where there is no compiler or it fails.
    """
    from cffi import FFI

    if is_current():
        return
    chosen = compiler()
    if not chosen:
        raise SystemExit("dtbacklash: needs a C compiler: install cc (gcc, clang), or `pip install ziglang`; or set CC")
    made, declared = HERE / f"{LIBRARY}.new", HERE / f"{DECLARED}.new"
    words = [*chosen, *flags(chosen), str(HERE / "core.c"), "-o", str(made), "-lm"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"dtbacklash: {' '.join(chosen)} cannot compile the core:\n{done.stderr.strip()}")
    ffi = FFI()
    ffi.cdef(declarations())
    ffi.set_source("dtbacklash.core._declared", None)
    with redirect_stdout(io.StringIO()):  # it says what it writes
        ffi.emit_python_code(str(declared))
    with declared.open("a", encoding="utf-8") as file:
        file.write(f"LAWS = {laws()!r}\nSOURCES = {digest()!r}\n")
    # renamed, not overwritten: processes that have loaded the old library keep it
    made.replace(HERE / LIBRARY)
    declared.replace(HERE / DECLARED)


if __name__ == "__main__":
    make()
