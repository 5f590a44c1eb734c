"""The methods that the demonstration compares, and why they are set as they are."""

from __future__ import annotations

from dataclasses import dataclass, replace

from phasestereo.matchers.opencv import match_sgbm
from phasestereo.matching import match
from phasestereo.rig.findings import unwarned
from phasestereo.settings import PRESETS, Settings
from phasestereo_bench.arrays import Image, Map

# As large as the disk, as in the paper. Wider ones help normalized SAD against the blur and cost
# everyone outlines; means over seeds 0 to 4, left image degraded, at 7, 9, 11 and 13 pixels:
# normalized SAD 43.6, 32.0, 30.1 and 30.8 % wrong, phase codes 16.5, 18.0, 20.1 and 22.6 %.
WINDOW = 7

# The paper's equation 9 asks for twice the disk's diameter. Left image degraded, L = 11, 13, 15 and
# 17: 20.1, 18.0, 18.3 and 19.9 % wrong over seeds 5 to 8; 18.1, 16.5, 17.2 and 19.4 over 0 to 4.
NEIGHBORHOOD = 13


@dataclass(frozen=True, slots=True)
class DemoMethod:
    """One way to match a pair.

    Attributes
    ----------
    key
        Its name in file names.
    name
        Its name in text.
    settings
        Those of `phasestereo.match`; None stands for OpenCV's StereoSGBM.
    preset
        The preset of which `settings` are shown as changes.
    """

    key: str
    name: str
    settings: Settings | None
    preset: str = "paper"

    @property
    def is_ours(self) -> bool:
        """Whether it compares phase codes."""
        return self.settings is not None and self.settings.cost == "phase"

    def match(self, left: Image, right: Image, num_disparities: int) -> Map:
        """Return the disparities of the left image, NaN where there is no estimate."""
        if self.settings is None:
            return match_sgbm(left, right, num_disparities)

        with unwarned():  # how bad a map is, its score says
            result = match(left, right, num_disparities=num_disparities, settings=self.settings)
        return result.disparity


_PAPER = PRESETS["paper"]

# Knows nothing of the blur, and nothing of it is tuned on these scenes.
ROBUST = DemoMethod("robust", "robust (finds the blur itself)", PRESETS["robust"], "robust")

# Penalties are the best for each on the scenes of seeds 5 to 8, both images sharp; in bits, gray
# levels and standard deviations. Means, % wrong:
#   phase codes      2: 14.4   4: 13.4   6: 13.0   8: 12.9   12: 13.6  (6 is better with blur)
#   SAD              2: 4.7    5: 4.2   10: 4.0   15: 4.2    20: 4.6
#   normalized SAD  .5: 6.5   .75: 6.3   1: 6.3  1.5: 6.4     2: 6.7   (1 is better with blur)
PHASE = DemoMethod(
    "phase",
    f"phase codes, L = {NEIGHBORHOOD}",
    replace(_PAPER, neighborhood=NEIGHBORHOOD, window=WINDOW, p1=6, p2=6),
)
# What one would take if both images were sharp: outlines are crisper, and blur does more harm.
SMALL = DemoMethod("phase7", "phase codes, L = 7", replace(_PAPER, window=WINDOW, p1=6, p2=6))
SAD = DemoMethod("sad", "SAD", replace(_PAPER, cost="sad", window=WINDOW, p1=10, p2=10))
NSAD = DemoMethod("nsad", "normalized SAD", replace(_PAPER, cost="nsad", window=WINDOW, p1=1, p2=1))
SGBM = DemoMethod("sgbm", "StereoSGBM (OpenCV)", None)

METHODS: tuple[DemoMethod, ...] = (ROBUST, PHASE, SMALL, SAD, NSAD, SGBM)
