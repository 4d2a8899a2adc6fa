"""The concealing simulator: it shares no law with :mod:`dtbacklash.physics`; that is its point."""
