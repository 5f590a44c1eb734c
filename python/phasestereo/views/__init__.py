"""What people look at: pictures, plots, notebooks, report pages, point clouds and meshes.

Each module says which extra it needs, and is imported when it is first asked for.
"""

from typing import TYPE_CHECKING

__all__ = ["depths", "meshing", "page", "picture", "plot", "registering", "triangulation"]

if TYPE_CHECKING:
    from phasestereo.views import (
        depths as depths,
        meshing as meshing,
        page as page,
        picture as picture,
        plot as plot,
        registering as registering,
        triangulation as triangulation,
    )
else:

    def __getattr__(name):
        """Import a module when it is first asked for, as `ps.views.plot`."""
        match name:
            case "depths":
                import phasestereo.views.depths as found
            case "meshing":
                import phasestereo.views.meshing as found
            case "page":
                import phasestereo.views.page as found
            case "picture":
                import phasestereo.views.picture as found
            case "plot":
                import phasestereo.views.plot as found
            case "registering":
                import phasestereo.views.registering as found
            case "triangulation":
                import phasestereo.views.triangulation as found
            case _:
                raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return found
