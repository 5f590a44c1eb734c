"""What several test files share: where the real data is."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def data() -> Path:
    """Return the folder of real pairs; without it, skip visibly, or fail where it must be there."""
    folder = Path(os.environ.get("PHASESTEREO_DATA", ROOT / "../shared"))
    if (folder / "middlebury").is_dir():
        return folder
    message = f"no real data in {folder.resolve()}: set PHASESTEREO_DATA to a folder of pairs"
    if os.environ.get("CI") == "true":
        pytest.fail(message)
    pytest.skip(message)
