"""What cameras see and what is found in it, while they run: a page for a browser on this machine.

`show` keeps what there is to show, `server` answers the browser, `diagnosing` looks at the pair
beside the matches. The page itself is made of the templates ``viewer.*``.
"""

from __future__ import annotations

from phasestereo_live.viewer.server import Server
from phasestereo_live.viewer.show import Display

__all__ = ["Display", "Server"]
