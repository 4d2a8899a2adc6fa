"""A rig for other simulation tools: an FMI 2.0 co-simulation slave whose step is the package's own simulation."""
