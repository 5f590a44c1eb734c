"""The commands ``phasestereo large``, ``batch`` and ``asp``, which entry points name."""
