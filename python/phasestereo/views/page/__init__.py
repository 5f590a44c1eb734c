"""The page of a pair: one HTML file that shows a result in any browser.

    write_pair_page("page.html", left, right, result, num_disparities=64)

The page needs no other files and no network. `page` puts it together, `layers` chooses the maps to
show pixel by pixel, `facts` words and numbers, `scene` the points of the 3-D view, and `embedding`
turns arrays into text. The templates ``pair.*`` do the rest.
"""

from __future__ import annotations

from phasestereo.views.page.page import write_pair_page

__all__ = ["write_pair_page"]
