"""``python -m dtbacklash.docs [FOLDER]`` writes the pages that are made from the code (default folder: ``docs``)."""

import sys
from pathlib import Path

from dtbacklash.docs.pages import write

for written in write(Path(sys.argv[1] if len(sys.argv) > 1 else "docs")):
    print(written)
