"""What is estimated of a pair: blur, rows, range, intensities; and what that means for a match."""
