"""Recordings in: read, checked, in SI units on a uniform time grid."""

from dtbacklash.recording.mapping import Mapping, load_mapping, mapping_names, mapping_of
from dtbacklash.recording.model import Recording, refined, split
from dtbacklash.recording.read import read_pair, read_recording
from dtbacklash.recording.several import read_together, sources_of

__all__ = [
    "Mapping",
    "Recording",
    "load_mapping",
    "mapping_names",
    "mapping_of",
    "read_pair",
    "read_recording",
    "read_together",
    "refined",
    "sources_of",
    "split",
]
