"""Bridges to other software: OpenCV, xarray, Dask, Pandora, Rerun, ROS, and video.

Each module says which extra it needs, and is imported when it is first asked for.
"""

from typing import TYPE_CHECKING

__all__ = ["dask", "opencv", "pandora", "rerun", "ros", "video", "xarray"]

if TYPE_CHECKING:
    from phasestereo.integrations import dask as dask
    from phasestereo.integrations import opencv as opencv
    from phasestereo.integrations import pandora as pandora
    from phasestereo.integrations import rerun as rerun
    from phasestereo.integrations import ros as ros
    from phasestereo.integrations import video as video
    from phasestereo.integrations import xarray as xarray
else:

    def __getattr__(name):
        """Import a module when it is first asked for, as `ps.integrations.opencv`."""
        match name:
            case "dask":
                import phasestereo.integrations.dask as found
            case "opencv":
                import phasestereo.integrations.opencv as found
            case "pandora":
                import phasestereo.integrations.pandora as found
            case "rerun":
                import phasestereo.integrations.rerun as found
            case "ros":
                import phasestereo.integrations.ros as found
            case "video":
                import phasestereo.integrations.video as found
            case "xarray":
                import phasestereo.integrations.xarray as found
            case _:
                raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return found
