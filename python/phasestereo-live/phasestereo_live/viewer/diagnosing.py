"""Diagnose the pair while matches run, as often as their time allows."""

from __future__ import annotations

from threading import Thread
from time import monotonic

from phasestereo.rig.diagnosis import check
from phasestereo_live.viewer.show import Display

_PAUSE = 1.0  # seconds
_SHARE = 4.0  # times the duration of a diagnosis: a fifth of one processor at most


def diagnosing(show: Display) -> Thread:
    """Start a thread that diagnoses the last pair again and again until the show closes."""

    def watch() -> None:
        index = None
        while not show.closed:
            start = monotonic()
            frame = show.frame
            if frame is not None and frame.index != index:
                index = frame.index
                show.diagnose(check(frame.left, frame.right))

            # After a longer diagnosis, leave matches undisturbed for longer.
            if show.wait_closed(max(_PAUSE, _SHARE * (monotonic() - start))):
                return

    thread = Thread(target=watch, name="phasestereo-diagnosing", daemon=True)
    thread.start()
    return thread
