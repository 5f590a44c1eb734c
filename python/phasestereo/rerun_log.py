"""Frames logged to rerun, which shows them as they come or replays them: https://rerun.io."""
