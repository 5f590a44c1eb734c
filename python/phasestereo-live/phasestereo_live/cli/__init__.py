"""The command ``phasestereo live``, which `phasestereo.cli` finds by its entry point."""
