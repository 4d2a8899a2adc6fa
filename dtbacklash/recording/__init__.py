"""Recordings in: read, checked, in SI units on a uniform time grid."""

from dtbacklash.recording.command import refined
from dtbacklash.recording.mapping import Mapping, load_mapping, mapping_names
from dtbacklash.recording.model import Recording, split
from dtbacklash.recording.plausible import check_units, expectations
from dtbacklash.recording.read import read_pair, read_recording

__all__ = [
    "Mapping",
    "Recording",
    "check_units",
    "expectations",
    "load_mapping",
    "mapping_names",
    "read_pair",
    "read_recording",
    "refined",
    "split",
]
