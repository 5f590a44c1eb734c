"""Estimates from a pair (blur, rows, range, intensities), and their meaning for a match."""
