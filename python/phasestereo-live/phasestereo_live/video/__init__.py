"""Read video from the sources of `stream`, and write its frames as video.

Sources are video files and streams (`decoding`), folders of images (`folders`) and cameras
(`cameras`). Each is a sequence of captures (`capture`) that fail one by one, not all at once.
`sources` recognizes them. Frames become pictures (`picture`), and pictures a video file
(`writing`). Video files need PyAV, cameras OpenCV: the extra ``live``.
"""

from __future__ import annotations

from phasestereo_live.video.picture import FramePicture
from phasestereo_live.video.writing import VideoWriter

__all__ = ["FramePicture", "VideoWriter"]
