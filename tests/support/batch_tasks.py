"""What a worker does in tests of time limits: a module that a process loads in no time."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from phasestereo_large.batch.work import match_files

if TYPE_CHECKING:
    from phasestereo_large.batch import PairFiles, Record
    from phasestereo_large.batch.work import Order


def sleepily(pair: PairFiles, work: Order, recipe: str) -> Record:
    """Match a pair, but for one at which the process does nothing that could be ended by asking."""
    if pair.name == "left1":
        time.sleep(1000)
    return match_files(pair, work, recipe)
