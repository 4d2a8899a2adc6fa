"""What tests of the physics share; makes the test-only package ``reference`` importable."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
