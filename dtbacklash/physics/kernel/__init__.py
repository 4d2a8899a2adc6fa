"""The compiled plant: arrays, forces, steps, samples."""
