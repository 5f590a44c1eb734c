"""What `rectify` takes as a calibration: a camera pair, or a rectification that was saved."""

from __future__ import annotations

from collections.abc import Mapping

from phasestereo.io.rigs.cameras import Cameras
from phasestereo.io.rigs.reading import (
    CalibrationSource,
    cameras_of_files,
    named_all,
    read_cameras,
    read_documents,
)
from phasestereo.rectification.record import Rectification, from_document, is_saved


def read_calibration(
    source: CalibrationSource | Rectification | Cameras,
) -> Cameras | Rectification:
    """Return the camera pair of a calibration, or a rectification that was saved.

    Parameters
    ----------
    source
        As `phasestereo.io.rigs.reading.read_cameras` takes it, or the file of a rectification. What
        is a camera pair or a rectification already is returned.

    Raises
    ------
    TypeError, OSError, ValueError, ImportError
        As `read_cameras`.
    """
    if isinstance(source, Rectification | Cameras):
        return source
    if isinstance(source, Mapping):
        return read_cameras(source)

    paths, documents = read_documents(source)
    name = named_all(paths)
    if len(documents) == 1 and is_saved(documents[0]):
        try:
            return from_document(documents[0])
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{name}: {error}") from error
    return cameras_of_files(documents, name)
