"""The schema of ``dtb paper``: its experiments are the paper's, so that nothing in them can be chosen."""

from dataclasses import dataclass


@dataclass
class PaperConfig:
    """Nothing to choose but the folder."""
