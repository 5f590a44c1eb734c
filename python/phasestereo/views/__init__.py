"""What people look at: pictures, plots, notebooks, report pages, point clouds and meshes.

Each module says which extra it needs, and asks for it when it is first called.
"""

from phasestereo.views import depths, meshing, page, picture, plot, registering, triangulation

__all__ = ["depths", "meshing", "page", "picture", "plot", "registering", "triangulation"]
