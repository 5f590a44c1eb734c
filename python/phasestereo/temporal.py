"""The temporal filter: the state that a `Matcher` carries from one video frame to the next."""

from __future__ import annotations

from phasestereo import _core
from phasestereo._numbers import check_type


class TemporalFilter:
    """Steadies the disparities of a video where neither image has changed.

    There a disparity is the mean over up to 8 frames whose disparities are within a pixel of each
    other; one that is farther off wins only after the same number of frames as had the other one. A
    pixel starts anew where either image has changed by more than its noise, at the pixel or at its
    match, or if the size, the type of the images, the settings or the range of disparities have
    changed. So after a cut, or with a moving camera, the maps equal those of single frames.

    A filter belongs to one video, whose frames are matched in order: pass it to each
    `Matcher.match`, as `phasestereo_live.stream` does. It keeps 15 bytes per pixel, 19 with
    confidences. Pickling drops its history.

    Notes
    -----
    A recursive mean, as in the temporal filters of depth cameras, after the majority vote of R. S.
    Boyer and J. S. Moore, *MJRTY - A Fast Majority Vote Algorithm*, 1981. With ``subpixel=False``,
    means of whole numbers have fractions.

    Examples
    --------
    >>> matcher, steady = ps.Matcher(preset="fast"), ps.TemporalFilter()
    >>> for left, right in frames:
    ...     result = matcher.match(left, right, num_disparities=64, temporal_filter=steady)
    """

    def __init__(self) -> None:
        self._core = _core.TemporalFilter()

    def __reduce__(self) -> tuple[type[TemporalFilter], tuple[()]]:
        """Return the constructor and arguments of a new filter without history."""
        return type(self), ()


def as_core_filter(temporal_filter: TemporalFilter | None) -> _core.TemporalFilter | None:
    """Return the filter of the core; refuse another type with a TypeError."""
    if temporal_filter is None:
        return None
    accepts = "a TemporalFilter or None"
    check_type("temporal_filter", temporal_filter, TemporalFilter, accepts)
    return temporal_filter._core  # of this module
