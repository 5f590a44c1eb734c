"""The commands ``phasestereo large``, ``batch`` and ``asp``, found by their entry points."""
