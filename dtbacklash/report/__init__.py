"""Figures, tables and pages: this package draws and formats results, it computes no physics."""
