"""What people look at: pictures, plots, notebooks, report pages, point clouds and meshes.

Each module says which extra it needs, and is imported when it is first asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING

__all__ = ["depths", "meshing", "page", "picture", "plot", "triangulation", "viewer"]

if TYPE_CHECKING:
    from phasestereo.views import depths as depths
    from phasestereo.views import meshing as meshing
    from phasestereo.views import page as page
    from phasestereo.views import picture as picture
    from phasestereo.views import plot as plot
    from phasestereo.views import triangulation as triangulation
    from phasestereo.views import viewer as viewer
else:

    def __getattr__(name):
        """Import a module when it is first asked for, as `ps.views.plot`."""
        if name in __all__:
            return import_module(f"{__name__}.{name}")
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
