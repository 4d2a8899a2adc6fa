"""Compiles the libraries in C: ``python -m dtbacklash.core.build``; the build backend does it for a wheel.

They are the core, and the simulator of concealed recordings, which shares no file with it. What Python may call is read
off the C sources: each law (``double NAME(const SLOT *at, const double *p)``), and each function whose name begins with
``dtb_``. So a function stands in one place, and a library knows nothing of Python.
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
from typing import NamedTuple

HERE = Path(__file__).parent
HEADERS = ("laws.h", "plant.h", "twin.h", "control.h", "loop.h", "adaptation.h", "external.h")
SOURCES = (
    "laws.c", "formula.c", "predict.c", "filter.c", "twin.c", "control.c", "estimate.c", "guard.c", "adaptation.c",
    "indexes.c", "loop.c", "exponential.c", "external.c", "model_exchange.c",
)  # fmt: skip
#: no contraction of a product and a sum into one rounding: results are those of any other compiler
FLAGS = ["-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-shared"]
#: GCC's: loops run over a few states as they are written, not in vectors with a rest, nor as calls of memset
LOOPS = ["-fno-tree-loop-vectorize", "-fno-tree-loop-distribute-patterns"]
#: a law: its name, its slot, its parameters one by one or as a row, and what stands in it
_LAW = re.compile(r"^double (\w+)\(const (\w+) \*at, const double \*(p|row)\)\s*\{(.*?)\}\n(?:\n|\Z)", re.M | re.DOTALL)
_CALLED = re.compile(r"^\w+ dtb_\w+\([^{;]*\)(?=\n?\s*\{)", re.MULTILINE)


class Library(NamedTuple):
    """A library: ``NAME.c``, the unit that includes the other files of its folder, and those that Python reads."""

    name: str
    folder: Path
    headers: tuple[str, ...]
    sources: tuple[str, ...]

    @property
    def file(self) -> Path:
        """The compiled library."""
        return self.folder / f"_{self.name}.so"

    @property
    def declared(self) -> Path:
        """The module of Python that says what is in it."""
        return self.folder / "_declared.py"

    @property
    def module(self) -> str:
        """The name of that module."""
        return ".".join(("dtbacklash", *self.declared.relative_to(HERE.parent).with_suffix("").parts))


CORE = Library("core", HERE, HEADERS, SOURCES)
SIMULATOR = Library("simulator", HERE.parent / "prove" / "simulator", ("machine.h",), ("laws.c", "simulator.c"))


def digest(library: Library) -> str:
    """Hash of what decides a library: sources, flags and platform, 16 hexadecimal digits."""
    files = [*sorted(file for kind in ("*.c", "*.h") for file in library.folder.glob(kind)), HERE / "build.py"]
    said = [*(file.read_bytes() for file in files), " ".join(FLAGS + LOOPS).encode(), sysconfig.get_platform().encode()]
    return hashlib.sha256(b"".join(said)).hexdigest()[:16]


def is_current(library: Library) -> bool:
    """Whether the library that is there was made of these sources."""
    there = library.declared.is_file() and library.file.is_file()
    return there and library.declared.read_text(encoding="utf-8").endswith(f"SOURCES = {digest(library)!r}\n")


def laws(library: Library) -> dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]]:
    """Law -> its slot, the states that it asks for, and its parameters by place, empty where it asks for another."""
    found = {}
    for name, slot, row, body in _LAW.findall((library.folder / "laws.c").read_text(encoding="utf-8")):
        places = {int(place): own for own, place in re.findall(r"(\w+) = p\[(\d+)\]", body)}
        parameters = tuple(places.get(k, "") for k in range(max(places, default=-1) + 1))
        states = tuple(dict.fromkeys(re.findall(r"at->(\w+)", body)))
        found[name] = slot, states, ("row",) if row == "row" else parameters
    return found


def declarations(library: Library) -> str:
    """What Python sees: the structs, the laws, and the functions that it calls."""
    headers, sources = (
        [(library.folder / name).read_text(encoding="utf-8") for name in names]
        for names in (library.headers, library.sources)
    )
    called = [one for source in sources for one in _CALLED.findall(source)]
    named = [f"double {name}(const {slot} *at, const double *p)" for name, (slot, _, _) in laws(library).items()]
    return "\n".join([*headers, *(f"{one};" for one in (*named, *called))])


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
    """Compile the libraries, and write down what is in them, beside their sources; not those that are there already.

    Raises SystemExit, with one line, where there is no compiler or it fails.
    """
    for library in (CORE, SIMULATOR):
        if not is_current(library):
            _make(library)


def _make(library: Library) -> None:
    from cffi import FFI

    chosen = compiler()
    if not chosen:
        raise SystemExit("dtbacklash: needs a C compiler: install cc (gcc, clang), or `pip install ziglang`; or set CC")
    made, declared = (file.with_name(f"{file.name}.{os.getpid()}") for file in (library.file, library.declared))
    words = [*chosen, *flags(chosen), str(library.folder / f"{library.name}.c"), "-o", str(made), "-lm"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"dtbacklash: {' '.join(chosen)} cannot compile the {library.name}:\n{done.stderr.strip()}")
    ffi = FFI()
    ffi.cdef(declarations(library))
    ffi.set_source(library.module, None)
    with redirect_stdout(io.StringIO()):  # it says what it writes
        ffi.emit_python_code(str(declared))
    with declared.open("a", encoding="utf-8") as file:
        file.write(f"LAWS: dict[str, tuple] = {laws(library)!r}\nSOURCES = {digest(library)!r}\n")
    # renamed, not overwritten: processes that have loaded the old library keep it
    made.replace(library.file)
    declared.replace(library.declared)


if __name__ == "__main__":
    make()
