"""``python -m dtbacklash.report.proof [FOLDER]`` redraws the docs' proof from its score (default: ``docs``)."""

import sys
from pathlib import Path

from dtbacklash.report.proof.page import redraw_docs

redraw_docs(Path(sys.argv[1] if len(sys.argv) > 1 else "docs"))
