"""Which code this is: hashes of the package's own sources."""

import hashlib
from functools import cache
from pathlib import Path

#: what compiled code is made of: changes elsewhere need no new compilation
COMPILED = ("compiled.py", "closed_loop.py", "physics", "control", "twin", "diagnose")


@cache
def digest(parts: tuple[str, ...] = (".",)) -> str:
    """Hash of the Python files in these parts (files or folders) of the package, 16 hexadecimal digits."""
    package = Path(__file__).parent
    total = hashlib.sha256()
    for part in parts:
        path = package / part
        for source in [path] if path.is_file() else sorted(path.rglob("*.py")):
            total.update(source.read_bytes())
    return total.hexdigest()[:16]
