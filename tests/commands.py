"""Commands in a process of their own, as somebody types them."""

import subprocess
import sys
from pathlib import Path


def dtb(folder: Path, *words: str) -> str:
    """Run ``dtb`` with these words in a folder; gives what it prints, and fails where it fails."""
    command = [sys.executable, "-m", "dtbacklash.cli", *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=1800)
    assert done.returncode == 0, done.stderr
    return done.stdout
