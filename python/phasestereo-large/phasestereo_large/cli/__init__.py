"""The commands ``phasestereo large`` and ``batch``, found by their entry points."""
