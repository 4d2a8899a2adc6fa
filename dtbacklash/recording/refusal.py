"""Why a recording cannot be used."""

SAMPLES_MIN = 100  # fewer samples cannot carry a diagnosis
VALUE_MAX = 1e12  # in SI; no sensor and no clock of a machine shows more
CHANGE_MIN = 1e-50  # in SI; squares of less are lost


class Refused(ValueError):
    """A recording that cannot be used; its text is one sentence. Becomes a UserError at the border."""


class NoTable(Refused):
    """One in which no table of numbers is."""
