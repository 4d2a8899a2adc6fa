"""What Python sees of the package, under ``import dtbacklash``: a command's work without a command line."""
