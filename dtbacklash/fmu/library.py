"""An FMU from C: its sources, the library that this computer's compiler makes of them, and its description."""

from __future__ import annotations

import hashlib
import platform
import subprocess
import tempfile
import zipfile
from importlib.resources import files
from pathlib import Path

from dtbacklash.core import build
from dtbacklash.errors import UserError
from dtbacklash.files import written
from dtbacklash.fmu.description import SOURCE, Model, build_description, described

#: version of FMI -> folder of the library in the FMU, by operating system and processor
PLATFORMS = {
    2: {"Linux": "linux64", "Darwin": "darwin64", "Windows": "win64"},
    3: {"Linux": "{}-linux", "Darwin": "{}-darwin", "Windows": "{}-windows"},
}
PROCESSORS = {"amd64": "x86_64", "arm64": "aarch64"}
LIBRARY = {"Linux": ".so", "Darwin": ".dylib", "Windows": ".dll"}


def read_source(name: str) -> str:
    """A C file of this package."""
    return files("dtbacklash.fmu").joinpath(name).read_text(encoding="utf-8")


def token_of(*texts: str) -> str:
    """What identifies an FMU of these sources, 32 hexadecimal digits."""
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:32]


def source_of(slave: str, token: str, version: int) -> str:
    """The C file of an FMU: a slave within the functions of FMI. version : of FMI, 2 or 3."""
    return "\n".join(
        [f'#define FMI {version}\n#define TOKEN "{token}"', read_source("fmi.h"), slave, read_source("fmi.c")]
    )


def write_fmu(
    model: Model, source: str, beside: dict[str, str], version: int, path: Path, shown: str | None = None
) -> None:
    """Write an FMU, at once or not at all.

    Parameters
    ----------
    source : its C file. beside : names of the files that this one includes -> their texts. version : of FMI, 2 or 3.
    path : of the new file. shown : the same as the user has written it.

    Raises
    ------
    UserError : there is no C compiler, or this computer is none that FMI has a name for; the file cannot be written.
    """
    chosen, system, processor = build.compiler(), platform.system(), platform.machine().lower()
    if not chosen or system not in LIBRARY:
        raise UserError("out", shown or str(path), "an FMU needs a C compiler: cc, or `pip install ziglang`; or set CC")
    folder = PLATFORMS[version][system].format(PROCESSORS.get(processor, processor))
    with tempfile.TemporaryDirectory() as scratch:
        sources = {SOURCE: source, **beside}
        for name, text in sources.items():
            Path(scratch, name).write_text(text, encoding="utf-8")
        library = Path(scratch, model.name + LIBRARY[system])
        words = [*chosen, *build.flags(chosen), "-fvisibility=hidden", SOURCE, "-o", library.name, "-lm"]
        done = subprocess.run(words, cwd=scratch, capture_output=True, text=True, check=False)
        if done.returncode:
            raise UserError("out", shown or str(path), f"{chosen[0]} cannot compile it: {_line(done.stderr)}")
        with (
            written(path, "out", shown, parents=False) as whole,
            zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as fmu,
        ):
            fmu.writestr("modelDescription.xml", described(model, version))
            fmu.write(library, f"binaries/{folder}/{library.name}")
            for name, text in sources.items():
                fmu.writestr(f"sources/{name}", text)
            if version == 3:
                fmu.writestr("sources/buildDescription.xml", build_description(model.name))


def _line(text: str) -> str:
    lines = [line for line in text.splitlines() if "error" in line] or text.splitlines()
    return lines[0] if lines else "it says nothing"
