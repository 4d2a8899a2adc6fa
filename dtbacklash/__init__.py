"""A simulator of a lead-screw drive with growing backlash, its controllers and its digital twin."""

__version__ = "0.1.0"
