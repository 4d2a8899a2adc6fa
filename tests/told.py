"""What a command says on stderr beside its progress, which comes only where the machine is slow."""

import re

PROGRESS = re.compile(r"dtb: .*, \d+ %(, about .+ left)?\n")


def without_progress(err: str) -> str:
    """Stderr of a command without the lines that say every ten seconds where it stands."""
    return "".join(line for line in err.splitlines(keepends=True) if not PROGRESS.fullmatch(line))
