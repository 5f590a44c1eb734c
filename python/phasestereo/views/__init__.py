"""Output for people: pictures, plots, notebooks, report pages, point clouds and meshes.

Each module names the extra it needs, and asks for it on the first call.
"""

from phasestereo.views import depths, meshing, page, picture, plot, registering, triangulation

__all__ = ["depths", "meshing", "page", "picture", "plot", "registering", "triangulation"]
