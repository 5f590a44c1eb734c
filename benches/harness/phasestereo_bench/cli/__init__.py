"""What the harness adds to the command line: ``phasestereo bench`` and ``phasestereo demo``."""
