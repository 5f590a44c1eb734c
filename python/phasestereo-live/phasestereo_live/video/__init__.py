"""Moving pictures in and out: what `stream` reads from, and where its frames may go.

Sources are video files and streams (`decoding`), folders of images (`folders`) and cameras
(`cameras`), each a sequence of captures (`capture`) that fail one by one and not all at once;
`sources` recognizes them. Frames become pictures (`picture`), and pictures a video file
(`writing`). Video files need PyAV, cameras OpenCV: the extra ``live``.
"""

from __future__ import annotations

from phasestereo_live.video.picture import FramePicture
from phasestereo_live.video.writing import VideoWriter

__all__ = ["FramePicture", "VideoWriter"]
