"""GPUs for phasestereo, by Vulkan or Metal: ``ps.Matcher(device="gpu")`` opens one.

The processor does all but the search for the best candidates, and that, too, where a GPU does not
take it or has failed: the result is the same to the bit.
"""

from phasestereo_gpu._gpu import Gpu, __version__, adapters

__all__ = ["Gpu", "__version__", "adapters"]
