"""Adds ``phasestereo bench`` and ``phasestereo demo`` to the command line."""
