"""Calibrations of two cameras, in the formats of camera makers and software.

This package holds their readers: files by kind (`documents`), the names that people give matrices
(`names`), files of one camera each (`singles`), makers' formats (`makers`), the reader that chooses
among them (`reading`), and the resulting camera pair (`cameras`).
"""
