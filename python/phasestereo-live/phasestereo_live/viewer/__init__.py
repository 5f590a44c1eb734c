"""A browser page on this machine that shows running cameras and their results.

`show` keeps the state to show, `server` answers the browser, `diagnosing` diagnoses the pair
alongside the matches. The templates ``viewer.*`` make the page itself.
"""

from __future__ import annotations

from phasestereo_live.viewer.server import Server
from phasestereo_live.viewer.show import Display

__all__ = ["Display", "Server"]
