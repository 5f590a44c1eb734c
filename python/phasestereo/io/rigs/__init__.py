"""Calibrations of two cameras, as makers of cameras and of software write them.

Here belongs what reads them: files by their kind (`documents`), the names that people give matrices
(`names`), files of one camera each (`singles`), the formats of makers (`makers`), the reader that
chooses among them (`reading`), and the camera pair that comes out (`cameras`).
"""
